"""Captures that are read and written again, without Blender."""

import json

import numpy as np
import pytest
from cumulo.capture import Capture

TRANSFER = {"kind": "piecewise", "points": [[0.0, 1.0, 0.5, 0.25, 0.0], [1.0, 0.1, 0.2, 0.3, 4.0]]}
# Not a multiple of a power of two, in columns of unit length.
TURN = [[0.8, 0.0, 0.6, 1 / 3], [0.0, 1.0, 0.0, 0.1], [-0.6, 0.0, 0.8, 2.7], [0.0, 0.0, 0.0, 1.0]]


def write(folder, **changes):
    """A `transforms.json` with every key that Cumulo knows, and some that it does not."""
    shared = {"file_path": "view_000.exr", "transform_matrix": TURN}
    data = {
        "model": "emission-absorption", "emission_model": "linear", "transfer": TRANSFER,
        "background": [0.1, 0.2, 0.3], "pixel_filter": "box", "near": 0.25, "density_scale": 7.1,
        "emission": [1.0, 0.5, 0.25], "lattice": [[0.1, 0.02, 0, 1], [0, 0.2, 0, 2], [0, 0, -0.3, 3], [0, 0, 0, 1]],
        "fl_x": 30.5, "fl_y": 31.0, "cx": 7.0, "cy": 9.5, "w": 16, "h": 20, "camera_model": "PINHOLE",
        "provenance": {"version": "1.2", "inputs": ["a.vdb"]}, "early_stop": {"transmittance": 1e-6},
        "frames": [shared, {**shared, "file_path": "b/view_001.exr", "near": 0.5, "w": 17, "colmap_im_id": 4}],
    }  # fmt: skip
    data |= changes
    (folder / "transforms.json").write_text(json.dumps({k: v for k, v in data.items() if v is not ...}))
    return data


def meaning(data):
    """The content of a `transforms.json`, with what all frames share in each."""
    intrinsics = {"fl_x", "fl_y", "cx", "cy", "w", "h", "camera_model"}
    shared = {key: value for key, value in data.items() if key in intrinsics}
    top = {key: value for key, value in data.items() if key not in intrinsics | {"frames"}}
    frames = [{"camera_model": "PINHOLE", **shared, **frame} for frame in data["frames"]]
    return top | {"frames": frames}


@pytest.mark.parametrize("model", ["absorption", "emission-absorption", "pre-shaded"])
def test_a_capture_that_is_read_and_written_again_is_the_same(tmp_path, model):
    before = write(tmp_path, model=model)
    Capture.read(tmp_path).write(tmp_path / "again.json")
    after = json.loads((tmp_path / "again.json").read_text())
    assert meaning(after) == meaning(before)


def test_captures_of_the_program_are_carried(tmp_path, cumulo, fixtures):
    (tmp_path / "f.tf.json").write_text(
        json.dumps({"format": "cumulo-transfer-function", "version": 1, "transfer": TRANSFER})
    )
    cumulo("render", fixtures / "plume.vdb", "--tf", tmp_path / "f.tf.json", "--views", 2, "--size", "8x6", "-o", tmp_path / "cap")
    before = json.loads((tmp_path / "cap" / "transforms.json").read_text())
    Capture.read(tmp_path / "cap").write(tmp_path / "cap" / "transforms.json")
    after = json.loads((tmp_path / "cap" / "transforms.json").read_text())
    assert before["transfer"] == TRANSFER and meaning(after) == meaning(before)
    # The program reads it again, and sees the same.
    cumulo("render", fixtures / "plume.vdb", "--cameras", tmp_path / "cap", "-o", tmp_path / "again")
    assert cumulo("compare", tmp_path / "cap" / "view_001.exr", tmp_path / "again" / "view_001.exr")["max_abs"] == 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"model": "neural"}, "model 'neural' is not one of absorption, emission-absorption, pre-shaded"),
        ({"emission_model": "fiery"}, "emission_model 'fiery' is not one of grey, linear"),
        ({"pixel_filter": "gauss"}, "pixel_filter 'gauss' is not one of point, box"),
        ({"transfer": [1, 2]}, "transfer is not a transfer function"),
        ({"camera_model": "OPENCV_FISHEYE"}, "frame 0.*camera_model is 'OPENCV_FISHEYE'"),
        ({"k1": 0.1}, "frame 0.*k1 is 0.1"),
        ({"frames": []}, "no frames"),
    ],
)
def test_what_would_be_shown_otherwise_is_refused(tmp_path, changes, message):
    write(tmp_path, **changes)
    with pytest.raises(ValueError, match=message):
        Capture.read(tmp_path)


def test_own_keys_are_not_given_twice(tmp_path):
    write(tmp_path)
    capture = Capture.read(tmp_path)
    capture.extra["model"] = "absorption"
    with pytest.raises(ValueError, match="'model' is one of the capture's own"):
        capture.write(tmp_path / "again.json")
    assert not (tmp_path / "again.json").exists()


def test_null_is_absent_and_angles_serve_either_axis(tmp_path):
    write(tmp_path, transfer=None, lattice=None, fl_x=..., fl_y=..., camera_angle_y=np.pi / 2)
    capture = Capture.read(tmp_path)
    assert capture.transfer is None and capture.lattice is None
    assert capture.frames[0][0].fl_x == capture.frames[0][0].fl_y == pytest.approx(10.0)
