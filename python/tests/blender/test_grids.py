"""Grids that `cumulo convert` makes of images and arrays lie in Blender where they lie in the world."""

import itertools

import bpy
import cumulo.blender  # noqa: F401  brings `openvdb`
import numpy as np
import openvdb
import pytest


def placed(path, name):
    """Index-to-object matrix of a grid as Blender has it, and its values as OpenVDB has them."""
    volume = bpy.data.volumes.new("probe")
    try:
        volume.filepath = str(path)
        assert volume.grids.load(), volume.grids.error_message
        matrix = np.array(volume.grids[name].matrix_object)
    finally:
        bpy.data.volumes.remove(volume)
    return matrix, openvdb.read(str(path), name)


@pytest.mark.parametrize("ending", ["vdb", "nii.gz", "nrrd", "mha", "vti"])
def test_labelled_corners_lie_where_the_transform_says(cumulo, tmp_path, ending):
    values = np.zeros((4, 5, 6), np.float32)
    corners = list(itertools.product((0, 3), (0, 4), (0, 5)))
    for label, corner in enumerate(corners, 1):
        values[corner] = label
    np.save(tmp_path / "cube.npy", values)
    # Turned by 3-4-5 about z, voxels of 0.5 x 0.25 x 2, off the origin: exact in single precision but for 0.6 and 0.8.
    lattice = np.array([[0.3, -0.2, 0, 10], [0.4, 0.15, 0, -20], [0, 0, 2, 30], [0, 0, 0, 1]])
    words = ",".join(str(v) for v in lattice[:3].flatten())
    cumulo("convert", tmp_path / "cube.npy", tmp_path / "cube.vdb", f"--transform={words}")
    found = tmp_path / "cube.vdb"
    if ending != "vdb":
        cumulo("convert", found, tmp_path / f"cube.{ending}")
        found = tmp_path / "back.vdb"
        cumulo("convert", tmp_path / f"cube.{ending}", found, "--grid=density")
    matrix, grid = placed(found, "density")
    accessor = grid.getConstAccessor()
    # Exporters write the box of active voxels, which begins at index 0 here as well.
    for label, corner in enumerate(corners, 1):
        assert accessor.getValue(corner) == label
        world = (matrix @ [*corner, 1])[:3]
        # Blender's matrices, and the headers of NIfTI, are of single precision: 2^-24 of 40, a few times over.
        assert world == pytest.approx((lattice @ [*corner, 1])[:3], abs=1e-5)


def test_a_scan_faces_forwards_and_left_is_left(cumulo, fixtures, tmp_path):
    cumulo("convert", fixtures / "head.nii.gz", tmp_path / "head.vdb", "--as=float", "--grid=density")
    matrix, grid = placed(tmp_path / "head.vdb", "density")
    values = np.zeros((48, 56, 40), np.float32)
    grid.copyToArray(values)

    def places(mask):
        return np.argwhere(mask) @ matrix[:3, :3].T + matrix[:3, 3]

    # The bead of metal at the left, and the nose in front (fixtures/make_head.py), half a voxel around.
    assert places(values == 2500).mean(0) == pytest.approx([-72, 0, 8], abs=3)
    nose = places((values == 60))
    nose = nose[nose[:, 1] > 96]
    assert len(nose) and abs(nose[:, 0]).max() <= 13 and abs(nose[:, 2] + 20).max() <= 18
