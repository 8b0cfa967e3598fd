"""Captures, and commands beside Blender."""

import json
import math

import numpy as np
import pytest
from cumulo import CumuloError
from cumulo.capture import Camera, Capture, look_at, sphere_cameras
from cumulo.exr import read_exr, write_exr


def test_written_captures_read_back(tmp_path):
    camera = Camera(look_at((1, 2, 3), (0, 0, 0)), 30.5, 31.0, 7.0, 9.5, 16, 20, orthographic=True)
    lattice = np.array([[0.1, 0.02, 0, 1], [0, 0.2, 0, 2], [0, 0, -0.3, 3], [0, 0, 0, 1]])
    capture = Capture(
        [(camera, tmp_path / "a.exr")], "emission-absorption", (0.1, 0.2, 0.3), "box", 0.25, 4.0, (1.0, 0.5, 0.25), lattice
    )
    capture.write(tmp_path / "transforms.json")
    again = Capture.read(tmp_path)
    (read, picture), = again.frames
    assert picture == tmp_path / "a.exr"
    assert np.allclose(read.camera_to_world, camera.camera_to_world, rtol=0, atol=4e-16)
    assert (read.fl_x, read.fl_y, read.cx, read.cy, read.width, read.height) == (30.5, 31.0, 7.0, 9.5, 16, 20)
    assert read.orthographic
    assert again.model == capture.model and again.background == capture.background and again.near == 0.25
    assert np.array_equal(again.lattice, lattice)


def test_field_of_view_and_frames_that_override(tmp_path):
    frame = {"file_path": "a.exr", "transform_matrix": np.eye(4).tolist()}
    data = {"camera_angle_x": math.radians(90), "w": 64, "h": 32, "frames": [frame, {**frame, "fl_x": 10, "w": 8}]}
    (tmp_path / "transforms.json").write_text(json.dumps(data))
    (first, _), (second, _) = Capture.read(tmp_path).frames
    assert first.fl_x == pytest.approx(32.0) and (first.cx, first.cy) == (32, 16)
    assert second.fl_x == 10 and second.width == 8


def test_what_is_wrong_is_named(tmp_path):
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps({"w": 8, "h": 8, "frames": [{"file_path": "a", "transform_matrix": np.eye(4).tolist()}]}))
    with pytest.raises(ValueError, match="frame 0.*fl_x nor camera_angle_x"):
        Capture.read(path)
    path.write_text('{"frames": [')
    with pytest.raises(ValueError, match="transforms.json: it is no JSON"):
        Capture.read(path)
    path.write_text('{"frames": []}')
    with pytest.raises(ValueError, match="no frames"):
        Capture.read(path)


def test_damaged_pictures_are_named(tmp_path):
    write_exr(tmp_path / "a.exr", np.random.default_rng(1).random((64, 64, 4), np.float32), "test", {})
    content = (tmp_path / "a.exr").read_bytes()
    (tmp_path / "a.exr").write_bytes(content[: len(content) // 2])
    with pytest.raises(ValueError, match="a.exr: it cannot be read"):
        read_exr(tmp_path / "a.exr")


def test_sphere_cameras_hold_the_box_in_view():
    low, high = np.array([-1.0, 2.0, 0.5]), np.array([3.0, 4.0, 9.0])
    corners = np.array([[(low, high)[i >> axis & 1][axis] for axis in range(3)] for i in range(8)])
    for camera in sphere_cameras(12, low, high, 40, 24):
        assert np.allclose(camera.camera_to_world[:3, :3].T @ camera.camera_to_world[:3, :3], np.eye(3))
        seen = (corners - camera.camera_to_world[:3, 3]) @ camera.camera_to_world[:3, :3]
        x = camera.cx - camera.fl_x * seen[:, 0] / seen[:, 2]
        y = camera.cy + camera.fl_y * seen[:, 1] / seen[:, 2]
        assert (seen[:, 2] < 0).all() and x.min() > 0 and x.max() < 40 and y.min() > 0 and y.max() < 24


def test_commands_report_and_refuse(cumulo, fixtures):
    same = cumulo("diff", fixtures / "plume.vdb", fixtures / "plume.vdb")["grids"]
    assert [grid["name"] for grid in same] == ["density"]
    assert same[0]["max_abs"] == 0 and same[0]["topology_iou"] == 1
    with pytest.raises(CumuloError, match=r"missing\.vdb"):
        cumulo("diff", fixtures / "plume.vdb", fixtures / "missing.vdb")
