"""Albedos by density against Cycles: what a function of `--tf-color albedo` says is there a grid of colours.

The function is linear over the densities of the volume, so that its value at an interpolated density is what Cycles
interpolates between its values at voxels. The extinction of a Principled Volume without an absorption colour is its
density whatever its colour, which is the albedo.
"""

import dataclasses
import functools
import json
import re

import bpy  # noqa: F401  before OpenVDB
import numpy as np
import pytest
import reference
from cumulo import arrays
from cumulo.blender import Settings, Stage, Sun
from cumulo.capture import Camera, Capture, look_at
from cumulo.exr import read_exr

import openvdb  # noqa: E402  `cumulo.blender` brings it

CELLS, VOXEL = 24, 1 / 12
VIEW = Camera(look_at((3.4, 2.4, 3.1), (1, 1, 1), (0, 0, 1)), 44.0, 44.0, 16.0, 16.0, 32, 32)
SUN = Sun((0.4, -0.5, 0.8), (3.0, 2.0, 1.0))
SKY = (0.4, 0.7, 1.0)
# Albedos at the densities 0 and 1, and what all are multiplied by.
THIN, THICK = (0.95, 0.6, 0.1), (0.2, 0.7, 0.98)
SCENES = {
    "all orders": {"lights": (SUN,), "sky": SKY},
    "single scattering": {"lights": (SUN,), "max_bounces": 1},
    "dense": {"lights": (SUN,), "sky": SKY, "density_scale": 30.0},
    "times 0.8, forward": {"sky": SKY, "anisotropy": 0.6, "factor": 0.8},
}


@dataclasses.dataclass(frozen=True)
class Scene:
    """A function over the density, extinction in proportion to it, and lights."""

    thin: tuple = THIN
    thick: tuple = THICK
    factor: float = 1.0
    density_scale: float = 5.0
    anisotropy: float = 0.0
    max_bounces: int = 1024
    lights: tuple = ()
    sky: tuple = (0.0, 0.0, 0.0)

    def but(self, **changes):
        """The scene with changes."""
        return dataclasses.replace(self, **changes)


def density():
    """Two lumps that run into each other, of all densities from 0 to 1; nothing in the outermost three layers."""
    x, y, z = np.meshgrid(*(np.linspace(-1, 1, CELLS),) * 3, indexing="ij")
    first = 1.2 - 5.0 * ((x + 0.2) ** 2 + (y - 0.1) ** 2 + (z + 0.2) ** 2)
    second = 1.0 - 9.0 * ((x - 0.35) ** 2 + (y + 0.2) ** 2 + (z - 0.3) ** 2)
    waves = np.sin(9 * x) * np.sin(8 * y + 1) * np.sin(7 * z)
    values = np.clip(np.maximum(first, second), 0, 1) * (0.75 + 0.25 * waves)
    assert values[3:-3, 3:-3, 3:-3].sum() == values.sum() and values.max() > 0.95
    return values.astype(np.float32)


def write(path, scene):
    """The density, and the grid of albedos that the scene's function makes of it, active everywhere."""
    values = density()
    colours = scene.factor * (np.array(scene.thin) + values[..., None] * (np.array(scene.thick) - scene.thin))
    grids = []
    for name, grid, data in (("density", openvdb.FloatGrid(), values), ("albedo", openvdb.Vec3SGrid(), colours)):
        grid.name, grid.transform = name, openvdb.createLinearTransform(VOXEL)
        grid.copyFromArray(np.ascontiguousarray(data, np.float32))
        # Through a function a volume ends at its outermost active voxels.
        accessor = grid.getAccessor()
        for ijk in np.ndindex(values.shape):
            accessor.setActiveState(ijk, True)
        grids.append(grid)
    openvdb.write(str(path), grids=grids)
    return path


def by_cycles(vdb, scene, samples):
    """A function of the seed that renders the picture."""
    settings = Settings(
        model="scattering", density_scale=scene.density_scale, background=(0, 0, 0), unbiased=True, samples=samples,
        anisotropy=scene.anisotropy, max_bounces=scene.max_bounces, lights=scene.lights, sky=scene.sky,
    )  # fmt: skip

    def film(seed):
        stage = Stage(settings, vdb)
        stage.medium.data.filepath = str(vdb)
        tree = stage.medium.data.materials[0].node_tree
        (medium,) = (node for node in tree.nodes if node.bl_idname == "ShaderNodeVolumePrincipled")
        attribute = tree.nodes.new("ShaderNodeAttribute")
        attribute.attribute_name = "albedo"
        tree.links.new(attribute.outputs["Color"], medium.inputs["Color"])
        return stage.film(VIEW, seed)

    return film


def by_cumulo(cumulo, folder, vdb, scene, seed):
    """The picture before black, [height, width, 4]."""
    points = [[0.0, *scene.thin, 0.0], [1.0, *scene.thick, scene.density_scale]]
    function, given = folder / "function.tf.json", folder / f"given{seed}"
    transfer = {"kind": "piecewise", "points": points}
    function.write_text(json.dumps({"format": "cumulo-transfer-function", "version": 1, "transfer": transfer}))
    Capture([(VIEW, folder / "view.exr")]).write(folder / "transforms.json")

    def listed(numbers):
        return ",".join(map(str, numbers))

    suns = [word for sun in scene.lights for word in
            (f"--sun={listed(sun.direction)}", f"--sun-color={listed(sun.irradiance)}", "--sun-angle=0")]  # fmt: skip
    report = cumulo(
        "render", vdb, "--grid", "density", "--tf", function, "--tf-color", "albedo", "--albedo", scene.factor,
        "--anisotropy", scene.anisotropy, *suns, f"--sky={listed(scene.sky)}", "--background", "0",
        "--max-bounces", scene.max_bounces, "--cameras", folder / "transforms.json", "--samples", 256, "--seed", seed,
        "--overwrite", "-o", given,
    )  # fmt: skip
    assert report["paths"]["majorant_violations"] == 0 and report["paths"]["impossible_directions"] == 0
    ((_, picture),) = Capture.read(given).frames
    return read_exr(picture).astype(np.float64)


def kept(folder, name, scene, samples=96):
    """Cycles' pictures. A file of OpenVDB has another number each time; this file says what is in it."""
    vdb = write(folder / "volume.vdb", scene)
    described = json.loads(json.dumps(dataclasses.asdict(scene)))
    film, name = by_cycles(vdb, scene, samples), "albedo_" + re.sub(r"[^a-z0-9]+", "_", name)
    return vdb, reference.of_cycles(name, film, [__file__], scene=described, samples=samples)


@pytest.mark.parametrize("name", SCENES)
def test_albedos_by_density_are_those_of_cycles(cumulo, cumulo_parity, tmp_path, name):
    scene = Scene(**SCENES[name])
    vdb, theirs = kept(tmp_path, name, scene)
    found = cumulo_parity.statistical(theirs, lambda seed, path: by_cumulo(cumulo, tmp_path, vdb, scene, seed))
    assert arrays.read_picture(cumulo_parity.scratch / f"{theirs.name}_1.exr").values.max() > 0.05
    print(f"p {found.p:8.2e}  {name}")


MEAN = tuple(0.5 * (a + b) for a, b in zip(THIN, THICK))
CHANGES = {
    "one albedo": {"thin": MEAN, "thick": MEAN},
    "2 % less": {"factor": 0.98},
    "thick ones redder": {"thick": (0.25, 0.7, 0.98)},
}


@pytest.mark.parametrize("change", CHANGES)
def test_another_albedo_is_told(cumulo, cumulo_parity, tmp_path, change):
    scene = Scene(**SCENES["all orders"])
    vdb, theirs = kept(tmp_path, "all orders", scene)
    ours = functools.partial(by_cumulo, cumulo, tmp_path, vdb, scene.but(**CHANGES[change]))
    with pytest.raises(pytest.fail.Exception, match="expected values differ"):
        cumulo_parity.statistical(theirs, lambda seed, path: ours(seed))
