"""Path tracing against Cycles: scattered light as Principled Volumes show it, two seeds on either side."""

import dataclasses
import functools
import json
import math
import re

import numpy as np
import pytest
from cumulo import arrays, blender
from cumulo.blender import Rectangle, Settings, Sphere, Sun
from cumulo.capture import Camera, Capture, look_at
from cumulo.exr import read_exr, write_exr
from cumulo.testing import volume

import openvdb  # noqa: E402  `cumulo.blender` brings it

# The plume is a box from 0 to 2.
VIEW = Camera(look_at((3.4, 2.4, 3.1), (1, 1, 1), (0, 0, 1)), 40.0, 40.0, 16.0, 16.0, 32, 32)
# Pixels along the edge of a block: in small ones at the plume's border Cycles' few paths all miss it, and
# two pictures without noise tell no standard error.
BLOCK = 16
INSIDE = Camera(look_at((1.02, 1.2, 0.96), (0.2, 1.9, 0.1), (0, 0, 1)), 25.0, 25.0, 16.0, 16.0, 32, 32)
SUN = Sun((0.4, -0.5, 0.8), (3.0, 2.0, 1.0))
SKY = (0.4, 0.7, 1.0)


def scattering(albedo, **options):
    """Settings of a grey albedo, or of one by channel."""
    albedo = tuple(albedo) if isinstance(albedo, tuple) else (albedo,) * 3
    return Settings(**{"model": "scattering", "density_scale": 3.0, "emission": (0, 0, 0), "background": (0, 0, 0),
                       "unbiased": True, "samples": 128, "albedo": albedo} | options)  # fmt: skip


SCENES = {
    "single scattering, sun": scattering(0.8, lights=(SUN,), max_bounces=1),
    "single scattering, wide sun, forward": scattering(
        0.8, lights=(dataclasses.replace(SUN, angle=0.5),), anisotropy=0.7, max_bounces=1
    ),
    "single scattering, sky": scattering(0.9, sky=SKY, max_bounces=1),
    "albedo 0.5": scattering(0.5, lights=(SUN,), sky=SKY),
    "albedo 0.9, backward": scattering(0.9, lights=(SUN,), sky=SKY, anisotropy=-0.6),
    "albedo 0.99, forward": scattering(0.99, lights=(SUN,), sky=SKY, anisotropy=0.6),
    "albedo 1": scattering(1.0, lights=(SUN,)),
    "narrow lobe": scattering(0.9, lights=(dataclasses.replace(SUN, angle=0.3),), anisotropy=0.9),
    "coloured albedo": scattering((0.95, 0.6, 0.2), lights=(SUN,), sky=SKY),
    "dense": scattering(0.9, lights=(SUN,), sky=SKY, density_scale=60.0),
    "thin": scattering(0.9, lights=(SUN,), sky=SKY, density_scale=0.05, samples=256),
    "picture of a sky": scattering(0.8, anisotropy=0.3),
    "sphere light": scattering(0.8, lights=(Sphere((2.6, 2.8, 2.4), 0.4, (8.0, 6.0, 4.0)),)),
    "absorption color": scattering((0.8, 0.5, 0.1), absorption_color=(0.05, 0.3, 0.9), lights=(SUN,), sky=SKY, anisotropy=0.4),
    "rectangle light": scattering(0.8, lights=(Rectangle((1.0, 1.0, 3.2), (0.2, 0.1, -1.0), (1.5, 0.8), (4.0, 5.0, 6.0)),)),
}


def sky(folder):
    """A picture of a sky with a sun that is up to one side, and a dark ground."""
    turn, rise = np.meshgrid((np.arange(64) + 0.5) / 64, (np.arange(32) + 0.5) / 32)
    sun = 30.0 * np.exp(-((turn - 0.3) ** 2 + (rise - 0.25) ** 2) / 0.002)
    pixels = np.stack([0.2 + sun, 0.3 + 0.3 * turn + 0.8 * sun, np.where(rise < 0.5, 0.8, 0.1) + 0.5 * sun, np.ones_like(sun)], axis=-1)
    write_exr(folder / "sky.exr", pixels.astype(np.float32), "test", {})
    return folder / "sky.exr"


def coefficients(settings):
    """Extinction by channel at density 1 and scale 1, and albedo, of a Principled Volume: its color c is scattered, and of
    the rest 1 - c the absorption color a takes the share 1 - sqrt(a)."""
    color, absorption = np.array(settings.albedo), np.array(settings.absorption_color)
    extinction = color + (1 - color) * (1 - np.sqrt(absorption))
    return extinction, color / np.maximum(extinction, 1e-9)


def fire(plume, path):
    """The plume with grids of a temperature, hottest in its lower half, and of a flame."""
    density = openvdb.read(str(plume), "density")
    low, high = (np.array(corner) for corner in density.evalActiveVoxelBoundingBox())
    x, y, z = np.meshgrid(*(np.linspace(-1, 1, n) for n in high - low + 1), indexing="ij")
    ball = np.clip(1 - 2.5 * (x**2 + y**2 + (z + 0.3) ** 2), 0, None)
    grids = [density]
    for name, values in (("temperature", 1.9 * ball**0.5 * (ball > 0)), ("flame", ball**2)):
        grid = openvdb.FloatGrid()
        grid.name, grid.transform = name, density.transform
        grid.copyFromArray(values.astype(np.float32), ijk=low.tolist())
        grids.append(grid)
    openvdb.write(str(path), grids=grids)
    return path


def scene_of(vdb, settings):
    """The scene as Cumulo reads it."""
    if settings.sky_file:
        lights = [{"type": "DomeLight", "texture": settings.sky_file}]
    else:
        lights = [{"type": "DomeLight", "radiance": list(settings.sky)}]
    for light in settings.lights:
        if isinstance(light, Sun):
            lights.append({"type": "DistantLight", "direction": list(light.direction),
                           "irradiance": list(light.irradiance), "angle": math.degrees(light.angle)})  # fmt: skip
        elif isinstance(light, Sphere):
            lights.append({"type": "SphereLight", "centre": list(light.centre), "radius": light.radius,
                           "radiance": list(light.radiance)})  # fmt: skip
        else:
            matrix = light.matrix()
            edges = [matrix[:3, axis] * size for axis, size in enumerate(light.size)]
            # Light leaves to the side of the product of the edges: -Z.
            corner = matrix[:3, 3] - 0.5 * (edges[0] + edges[1])
            lights.append({"type": "RectLight", "corner": corner.tolist(), "edges": [edges[1].tolist(), edges[0].tolist()],
                           "radiance": list(light.radiance)})  # fmt: skip
    extinction, albedo = coefficients(settings)
    medium = {"density_scale": settings.density_scale, "extinction_color": extinction.tolist(), "albedo": albedo.tolist(),
              "anisotropy": settings.anisotropy}  # fmt: skip
    if settings.emission_grid:
        medium["emission_grid"] = {"grid": settings.emission_grid, "radiance": list(settings.emission)}
    if settings.blackbody:
        medium["blackbody"] = {"kelvin": settings.kelvin, "intensity": settings.blackbody}
    return {"volumes": [{"file": str(vdb), "medium": medium}], "lights": lights}


def by_cumulo(cumulo, folder, vdb, camera, settings, seed):
    """The picture before black, [height, width, 4]."""
    Capture([(camera, folder / "view.exr")]).write(folder / "transforms.json")
    scene, given = folder / "scene.json", folder / f"given{seed}"
    scene.write_text(json.dumps(scene_of(vdb, settings)))
    report = cumulo(
        "render", scene, "--cameras", folder / "transforms.json", "--samples", 256, "--seed", seed,
        "--max-bounces", settings.max_bounces, "--background", "0", "--overwrite", "-o", given,
    )  # fmt: skip
    # Where nothing scatters, no paths are traced.
    paths = report.get("paths", {"majorant_violations": 0, "impossible_directions": 0})
    assert paths["majorant_violations"] == 0 and paths["impossible_directions"] == 0
    (_, picture), = Capture.read(given).frames
    return read_exr(picture).astype(np.float64)


def of_cycles(vdb, camera, name, settings):
    """Cycles' pictures as a reference."""
    place = "inside" if camera is INSIDE else "outside"
    return volume(vdb, camera, settings, name=f"scattering_{re.sub(r'[^a-z0-9]+', '_', name)}_{place}")


@pytest.mark.parametrize("camera", [VIEW, INSIDE], ids=["outside", "inside"])
def test_scattered_light_is_that_of_cycles(fixtures, cumulo, cumulo_parity, tmp_path, subtests, camera):
    vdb = fixtures / "plume.vdb"
    for name, settings in SCENES.items():
        if camera is INSIDE and name not in ("albedo 0.9, backward", "sphere light"):
            continue
        with subtests.test(name):
            if name == "picture of a sky":
                settings = dataclasses.replace(settings, sky_file=str(sky(tmp_path)))
            ours = functools.partial(by_cumulo, cumulo, tmp_path, vdb, camera, settings)
            found = cumulo_parity.statistical(of_cycles(vdb, camera, name, settings), lambda seed, path: ours(seed), tile=BLOCK)
            assert arrays.read_picture(cumulo_parity.scratch / f"{of_cycles(vdb, camera, name, settings).name}_1.exr").values.max() > 0.003
            print(f"p {found.p:8.2e}  {name}")


@pytest.mark.parametrize("emission", ["flame", "blackbody"])
def test_fire_is_that_of_cycles(fixtures, cumulo, cumulo_parity, tmp_path, emission):
    """Fire seen through smoke that it lights."""
    plume = fixtures / "plume.vdb"
    vdb = fire(plume, tmp_path / "fire.vdb")
    emits = {"emission_grid": "flame", "emission": (3.0, 1.5, 0.5)} if emission == "flame" else {"blackbody": 1.0, "kelvin": 2000.0}
    for medium in ({"albedo": 0.0}, {"albedo": 0.9, "anisotropy": 0.5}):
        settings = scattering(**medium, **emits)
        kept = of_cycles(vdb, VIEW, f"{emission} {medium['albedo']}", settings)
        # A file of OpenVDB has another number each time; the plume and this file say what is in it.
        kept = dataclasses.replace(kept, inputs=[plume, __file__, *(path for path in kept.inputs if path != vdb)])
        ours = [by_cumulo(cumulo, tmp_path, vdb, VIEW, settings, seed) for seed in (1, 2)]
        assert (ours[0].max(axis=(0, 1)) > 0.01).all()
        found = cumulo_parity.statistical(kept, lambda seed, path: ours[seed - 1], tile=BLOCK)
        print(f"p {found.p:8.2e}  {emission}, {medium}")
        # Fire that is brighter by a twentieth would be found.
        with pytest.raises(pytest.fail.Exception, match="expected values differ"):
            cumulo_parity.statistical(kept, lambda seed, path: ours[seed - 1] * (1.05, 1.05, 1.05, 1.0), tile=BLOCK)


def test_a_biased_picture_is_found(fixtures, cumulo, cumulo_parity, tmp_path):
    vdb, name = fixtures / "plume.vdb", "albedo 0.9, backward"
    right = SCENES[name]
    for change in ({"albedo": (0.92,) * 3}, {"anisotropy": -0.5}, {"max_bounces": 3}, {"density_scale": 3.3}):
        ours = functools.partial(by_cumulo, cumulo, tmp_path, vdb, VIEW, dataclasses.replace(right, **change))
        with pytest.raises(pytest.fail.Exception, match="expected values differ"):
            cumulo_parity.statistical(of_cycles(vdb, VIEW, name, right), lambda seed, path: ours(seed), tile=BLOCK)
