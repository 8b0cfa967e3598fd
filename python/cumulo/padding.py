"""Copies of VDB grids that Cycles renders whole (needs the `openvdb` module, which Blender brings)."""

import functools
import os
import pathlib

import numpy as np

try:
    import openvdb
except ImportError:
    # Its name before Blender 4.4.
    import pyopenvdb as openvdb


def read_grid(path, grid):
    """One grid of a VDB file. Raises ValueError that names the file and its grids where it has no such."""
    try:
        return openvdb.read(str(path), grid)
    except KeyError:
        raise ValueError(f"{path}: no grid {grid!r}; it has {', '.join(grid_names(path)) or 'none'}") from None
    except RuntimeError as error:
        raise ValueError(f"{path}: OpenVDB cannot read it: {error}") from error


def grid_names(path):
    """Names of the grids of a VDB file. Raises ValueError where OpenVDB cannot read it."""
    try:
        return [grid.name for grid in openvdb.readAllGridMetadata(str(path))]
    except RuntimeError as error:
        raise ValueError(f"{path}: OpenVDB cannot read it: {error}") from error


def moved_copy(path, grid, transform, target):
    """Copies one grid to the new file `target`, moved by the matrix `transform` (column vectors)."""
    source = read_grid(path, grid)
    matrix = np.asarray(transform, dtype=np.float64) @ index_to_world(source)
    source.transform = openvdb.createLinearTransform(matrix.T.tolist())
    openvdb.write(str(target), grids=[source])


def padded_copy(path, grids, folder, transform=None, chunk=128, margin=2):
    """Copies scalar grids to a new file in `folder`, moved by the matrix `transform` (column vectors), each with `margin` active zero voxels around what
    is not zero; returns the new path.

    Cycles renders inside a mesh around the active leaves and tiles, and on their low sides that mesh
    stops at the first voxel's centre: of a block that begins where a leaf does it loses the ramp
    from -1 to 0. Of a mirroring transform that mesh is inside out and nothing is seen: the copy counts
    its z index the other way round. A new path each time, too: Blender keeps grids by path and never
    looks again.
    """
    padded = pathlib.Path(folder) / f"{pathlib.Path(path).stem}.padded.vdb"
    openvdb.write(str(padded), grids=[_padded(path, grid, transform, chunk, margin) for grid in grids])
    return padded


def _padded(path, grid, transform, chunk, margin):
    """The copy of one grid."""
    source = read_grid(path, grid)
    if np.ndim(source.background) != 0 or source.background != 0:
        raise ValueError(f"{path}: grid {grid!r} is no fog volume: its background is {source.background}, not 0")
    copy = openvdb.FloatGrid()
    copy.name, copy.gridClass = grid, source.gridClass
    matrix = index_to_world(source)
    if transform is not None:
        matrix = np.asarray(transform, dtype=np.float64) @ matrix
    mirrored = np.linalg.det(matrix[:3, :3]) < 0
    if mirrored:
        matrix[:, 2] *= -1
    copy.transform = openvdb.createLinearTransform(matrix.T.tolist())
    # Whatever differs from the background becomes active, so zeros can be; afterwards it becomes 0.
    copy.background = nothing = -float(np.finfo(np.float32).max)
    low, high = source.evalActiveVoxelBoundingBox()
    if source.activeVoxelCount():
        starts = [range(a - margin, b + margin + 1, chunk) for a, b in zip(low, high)]
        for x in starts[0]:
            for y in starts[1]:
                for z in starts[2]:
                    values = np.zeros([chunk + 2 * margin] * 3, dtype=np.float32)
                    source.copyToArray(values, ijk=(x - margin, y - margin, z - margin))
                    near = values != 0
                    for axis in range(3):
                        near = _widened(near, axis, margin)
                    if near.any():
                        inner = values[(slice(margin, -margin),) * 3]
                        block = np.where(near, inner, np.float32(nothing))
                        if mirrored:
                            block = np.ascontiguousarray(block[:, :, ::-1])
                        copy.copyFromArray(block, ijk=(x, y, 1 - z - chunk if mirrored else z))
    copy.background = 0.0
    return copy


def _widened(mask, axis, margin):
    """The mask without `margin` at both ends of `axis`, true where it was true within `margin`."""
    length = mask.shape[axis] - 2 * margin
    parts = [np.take(mask, range(shift, shift + length), axis) for shift in range(2 * margin + 1)]
    return np.logical_or.reduce(parts)


def lattice(path, grid):
    """Index-to-world matrix of a grid, [4, 4] f64 on column vectors, and its active index box
    (low, high), both inclusive. Raises ValueError where the grid has nothing in it."""
    try:
        state = os.stat(path)
        stamp = (state.st_mtime_ns, state.st_size)
    except OSError:
        stamp = None
    matrix, box = _lattice(str(path), grid, stamp)
    return matrix.copy(), box


@functools.lru_cache(maxsize=256)
def _lattice(path, grid, stamp):
    """The lattice of a grid in the file as it was at `stamp`: to know it, all of the grid is read, and animations ask for
    the same one in every frame."""
    source = read_grid(path, grid)
    if not source.activeVoxelCount():
        raise ValueError(f"{path}: grid {grid!r} has no active voxels; there is nothing to see")
    return index_to_world(source), source.evalActiveVoxelBoundingBox()


def index_to_world(source):
    """The grid's transform as [4, 4] f64 on column vectors. Raises ValueError where it is no matrix."""
    if not source.transform.isLinear:
        raise ValueError(f"grid {source.name!r} lies in a frustum, which no matrix describes; resample it")
    origin = np.array(source.transform.indexToWorld((0, 0, 0)))
    matrix = np.eye(4)
    matrix[:3, 3] = origin
    for axis in range(3):
        unit = [float(axis == other) for other in range(3)]
        matrix[:3, axis] = np.array(source.transform.indexToWorld(unit)) - origin
    return matrix


def world_box(matrix, box):
    """World box (low, high) of index box `box` under `matrix`, half a voxel wider on every side."""
    low, high = np.array(box[0]) - 0.5, np.array(box[1]) + 0.5
    corners = [[(low, high)[i >> axis & 1][axis] for axis in range(3)] + [1.0] for i in range(8)]
    world = np.array(corners) @ matrix[:3].T
    return world.min(0), world.max(0)
