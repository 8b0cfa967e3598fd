"""Maps that mrcfile writes land where its headers say."""

import cubes
import mrcfile
import numpy as np
import pytest


@pytest.mark.parametrize("kind", [np.int8, np.int16, np.uint16, np.float16, np.float32])
@pytest.mark.parametrize("packed", [False, True])
def test_modes(cumulo, tmp_path, kind, packed):
    path = tmp_path / ("in.mrc.gz" if packed else "in.mrc")
    with mrcfile.new(path, compression="gzip" if packed else None) as map:
        map.set_data(np.ascontiguousarray(cubes.array().transpose(2, 1, 0)).astype(kind))
        map.set_volume()
        map.voxel_size = tuple(np.diag(cubes.STRAIGHT)[:3])
        map.header.origin = tuple(cubes.STRAIGHT[:3, 3])
    # Sizes of cells and origins are single precision; these are exact in it.
    options = ["--as=int"] if np.dtype(kind).kind == "f" else []
    cubes.passes(cumulo, path, cubes.STRAIGHT, tmp_path, *options, tolerance=cubes.DOUBLE)


@pytest.mark.parametrize("axes", [(1, 2, 3), (3, 1, 2), (2, 3, 1), (3, 2, 1)])
def test_order_of_axes(cumulo, tmp_path, axes):
    """Columns, rows and sections along any axes of the cell, which starts elsewhere."""
    path, step, start = tmp_path / "in.map", np.array([0.5, 0.75, 1.25]), np.array([4, -2, 3])
    with mrcfile.new(path) as map:
        map.set_data(np.ascontiguousarray(cubes.array().transpose(2, 1, 0)))
        map.set_volume()
        map.header.mapc, map.header.mapr, map.header.maps = axes
        map.header.mx = map.header.my = map.header.mz = 8
        map.header.cella = tuple(8 * step)
        map.header.nxstart, map.header.nystart, map.header.nzstart = start
    wanted = np.eye(4)
    for index, axis in enumerate(axes):
        wanted[:3, index] = 0
        wanted[axis - 1, index] = step[axis - 1]
        wanted[axis - 1, 3] = start[index] * step[axis - 1]
    cubes.passes(cumulo, path, wanted, tmp_path, tolerance=cubes.DOUBLE)
