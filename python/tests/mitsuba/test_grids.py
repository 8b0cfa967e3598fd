"""Grids (`.vol`) that Cumulo writes are those that Mitsuba reads, and the other way round: values and places."""

import struct

import mitsuba as mi
import numpy as np
import pytest

mi.set_variant("scalar_rgb")
SIZE = (5, 4, 3)
STEP, ORIGIN = np.array([0.5, 0.75, 1.25]), np.array([10.5, -20.25, 30.125])


def values(channels):
    """Values [z, y, x, channel], no two of which are alike; thirds, which single precision rounds."""
    x, y, z = SIZE
    return ((np.arange(x * y * z * channels, dtype=np.float32) + 1) / np.float32(3)).reshape(z, y, x, channels)


def placed(path):
    """Writes the box of `STEP` and `ORIGIN` into a file of Mitsuba, whose writer has the unit cube alone."""
    low = ORIGIN - 0.5 * STEP
    content = bytearray(path.read_bytes())
    content[24:48] = struct.pack("<6f", *low, *(low + STEP * SIZE))
    path.write_bytes(content)


def centres():
    """World positions [z, y, x, axis] of the voxels."""
    x, y, z = np.meshgrid(*(np.arange(n) for n in SIZE), indexing="ij")
    return (ORIGIN + np.stack([x, y, z], axis=-1) * STEP).transpose(2, 1, 0, 3)


def seen(points, channels, **grid):
    """What the plugin finds at points [z, y, x, axis], and its box."""
    volume = mi.load_dict({"type": "gridvolume", "raw": True, "filter_type": "nearest", **grid})
    found = []
    for point in points.reshape(-1, 3):
        interaction = mi.Interaction3f()
        interaction.p = mi.Point3f(*point)
        found.append(np.array(volume.eval_1(interaction) if channels == 1 else volume.eval_3(interaction)))
    z, y, x = SIZE[::-1]
    return np.array(found).reshape(z, y, x, channels), volume.bbox()


@pytest.mark.parametrize("channels", [1, 3])
def test_written_grids_are_seen(cumulo, tmp_path, channels):
    wanted = values(channels)
    array = wanted[..., 0] if channels == 1 else wanted
    np.save(tmp_path / "a.npy", array)
    place = [f"--spacing={','.join(map(str, STEP))}", f"--origin={','.join(map(str, ORIGIN))}"]
    cumulo("convert", tmp_path / "a.npy", tmp_path / "a.vdb", "--axes=zyx", *place)
    cumulo("convert", tmp_path / "a.vdb", tmp_path / "a.vol")
    grid = mi.VolumeGrid(str(tmp_path / "a.vol"))
    assert np.array_equal(np.array(grid).reshape(wanted.shape), wanted)
    found, box = seen(centres(), channels, filename=str(tmp_path / "a.vol"), use_grid_bbox=True)
    # Every number of the box is exact in single precision.
    assert np.array_equal(np.array(box.min), ORIGIN - 0.5 * STEP)
    assert np.array_equal(np.array(box.max), ORIGIN + (np.array(SIZE) - 0.5) * STEP)
    assert np.array_equal(found.astype(np.float32), wanted)


@pytest.mark.parametrize("channels", [1, 3])
def test_grids_of_mitsuba_are_read(cumulo, tmp_path, channels):
    wanted = values(channels)
    mi.VolumeGrid(wanted).write(str(tmp_path / "b.vol"))
    report = cumulo("convert", tmp_path / "b.vol", tmp_path / "unit.vdb")
    # Without a box of its own, the unit cube.
    transform = np.array(report["grid"]["transform"])
    assert np.allclose(transform[:3, :3], np.diag(1 / np.array(SIZE)), rtol=4 * np.finfo(float).eps, atol=0)
    assert np.allclose(transform[:3, 3], 0.5 / np.array(SIZE), rtol=4 * np.finfo(float).eps, atol=0)
    placed(tmp_path / "b.vol")
    report = cumulo("convert", tmp_path / "b.vol", tmp_path / "b.vdb")
    transform = np.array(report["grid"]["transform"])
    assert np.array_equal(transform[:3, :3], np.diag(STEP)) and np.array_equal(transform[:3, 3], ORIGIN)
    cumulo("convert", tmp_path / "b.vdb", tmp_path / "b.npy", "--axes=zyx")
    assert np.array_equal(np.load(tmp_path / "b.npy").reshape(wanted.shape), wanted)
    # Written again, the file is the same.
    cumulo("convert", tmp_path / "b.vdb", tmp_path / "c.vol")
    assert (tmp_path / "c.vol").read_bytes() == (tmp_path / "b.vol").read_bytes()


def test_turned_voxels_are_placed_by_to_world(cumulo, tmp_path):
    """As the guide says of grids that a `.vol` cannot hold."""
    wanted = values(1)
    np.save(tmp_path / "a.npy", wanted[..., 0])
    turn = np.array([[0.6, -0.8, 0, 3], [0.8, 0.6, 0, -2], [0, 0, 1, 0.5]]) * [0.5, 0.75, 1.25, 1]
    cumulo("convert", tmp_path / "a.npy", tmp_path / "a.vdb", "--axes=zyx", f"--transform={','.join(map(str, turn.flat))}")
    report = cumulo("convert", tmp_path / "a.vdb", tmp_path / "b.npy", "--axes=zyx")
    placement = mi.ScalarTransform4f(np.array(report["grid"]["transform"]))
    place = placement @ mi.ScalarTransform4f().translate([-0.5] * 3) @ mi.ScalarTransform4f().scale(SIZE)
    x, y, z = np.meshgrid(*(np.arange(n) for n in SIZE), indexing="ij")
    points = np.stack([x, y, z], axis=-1).transpose(2, 1, 0, 3) @ turn[:, :3].T + turn[:, 3]
    grid = mi.VolumeGrid(np.load(tmp_path / "b.npy")[..., None])
    found, _ = seen(points, 1, grid=grid, to_world=place)
    assert np.array_equal(found.astype(np.float32), wanted)
