"""The generator and the committed files agree, voxel for voxel."""

import cumulo.blender  # noqa: F401  brings `openvdb`
import make_fixtures
import numpy as np
import openvdb
import pytest

# Distances of a level set come from the library's square roots, which another build may round
# otherwise: a few units in the last place of 0.375, the widest of them.
TOLERANCE = {"sphere_level_set.vdb": 4 * 0.375 * 2.0**-24}

GRIDS = [(name, grid.name) for name, grids in make_fixtures.all_fixtures(openvdb).items() for grid in grids]


def voxels(grid, box):
    """Values in the index box, and the active ones' count by value iteration."""
    shape = [b - a + 1 for a, b in zip(*box)]
    kind = {"float": np.float32, "double": np.float64, "vec3s": np.float32, "int32": np.int32, "bool": bool}[grid.valueTypeName]
    values = np.zeros(shape + [3] if grid.valueTypeName == "vec3s" else shape, dtype=kind)
    grid.copyToArray(values, ijk=box[0])
    return values


@pytest.mark.parametrize(("name", "grid_name"), GRIDS)
def test_generator_makes_the_committed_voxels(fixtures, name, grid_name):
    made = next(g for g in make_fixtures.all_fixtures(openvdb)[name] if g.name == grid_name)
    stored = openvdb.read(str(fixtures / name), grid_name)
    box = stored.evalActiveVoxelBoundingBox()
    assert made.evalActiveVoxelBoundingBox() == box
    assert made.activeVoxelCount() == stored.activeVoxelCount()
    assert made.leafCount() == stored.leafCount()
    assert made.gridClass == stored.gridClass
    for point in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)):
        assert made.transform.indexToWorld(point) == stored.transform.indexToWorld(point)
    wider = ([a - 2 for a in box[0]], [b + 2 for b in box[1]])
    expected = voxels(made, wider)
    if made.saveFloatAsHalf:
        expected = expected.astype(np.float16).astype(np.float32)
    difference = np.abs(expected.astype(np.float64) - voxels(stored, wider)).max()
    assert difference <= TOLERANCE.get(name, 0.0)


def test_the_fixtures_are_what_their_names_say(fixtures):
    tiles = openvdb.read(str(fixtures / "tiles.vdb"), "density")
    assert tiles.activeVoxelCount() > 512 * tiles.leafCount(), "active tiles outweigh the leaves"
    assert openvdb.read(str(fixtures / "plume.vdb"), "density").saveFloatAsHalf
    sheared = openvdb.read(str(fixtures / "blob_sheared.vdb"), "density").transform
    axes = np.array([sheared.indexToWorld(e) for e in np.eye(3).tolist()]) - sheared.indexToWorld((0, 0, 0))
    assert np.linalg.det(axes) < 0, "mirrored"
    assert abs(axes[0] @ axes[2]) > 1e-3, "sheared"


def test_the_folder_stays_small(fixtures):
    assert sum(path.stat().st_size for path in fixtures.glob("*.vdb")) < 600_000
