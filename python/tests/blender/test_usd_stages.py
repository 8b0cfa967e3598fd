"""USD stages, as Blender writes them and as others do: Cumulo shows what Cycles shows, two seeds on either side."""

import dataclasses
import functools
import pathlib
import re
import shutil

import bpy
import numpy as np
import pytest
import reference
from cumulo import blender, padding
from cumulo.blender import Rectangle, Settings, Sphere, Sun
from cumulo.capture import Camera, Capture, look_at
from cumulo.cycles.materials import medium_material
from cumulo.cycles.objects import place_camera
from cumulo.cycles.stage import empty_scene, prepare_scene, quiet
from cumulo.exr import read_exr, write_exr
from cumulo.testing import volume

from pxr import Usd, UsdUtils  # noqa: E402  Blender's own, which `cumulo.blender` brings

WIDTH, HEIGHT = 48, 36
# The plume is a box from 0 to 2.
VIEW = Camera(look_at((3.4, 2.4, 3.1), (1, 1, 1), (0, 0, 1)), 60.0, 60.0, 25.5, 17.0, WIDTH, HEIGHT)
# Tiles whose pixels are many enough to tell a standard error.
TILE = 12
DENSITY = 3.0
ABSORBING = Settings(density_scale=DENSITY, unbiased=True, samples=64, background=(1.0, 1.0, 1.0))


def scattering(**options):
    return Settings(**{"model": "scattering", "density_scale": DENSITY, "emission": (0, 0, 0), "background": (0, 0, 0),
                       "unbiased": True, "samples": 96, "albedo": (0.8, 0.8, 0.8), "max_bounces": 8} | options)  # fmt: skip


@pytest.fixture
def alike(cumulo, cumulo_parity, tmp_path):
    """Function that compares a stage, before black, with a reference of Cycles."""

    def compare(of_cycles, stage, settings, *options):
        if settings.model == "scattering":
            options = (*options, "--albedo", settings.albedo[0], "--max-bounces", settings.max_bounces)

        def render(seed, path):
            given = tmp_path / f"given{seed}"
            cumulo(
                "render", stage, "--size", f"{WIDTH}x{HEIGHT}", "--density-scale", settings.density_scale, "--samples", 144,
                "--seed", seed, "--background", "0", "--overwrite", "-o", given, *options,
            )  # fmt: skip
            (_, picture), = Capture.read(given).frames
            pixels = read_exr(picture)
            shown = [0, 1, 2, 3] if settings.model == "scattering" else [3]
            assert (pixels[..., shown].max(axis=(0, 1)) > 0.01).all(), "the plume is in the picture"
            return picture

        return cumulo_parity.statistical(of_cycles, render, tile=TILE)

    return compare


# What Blender writes: settings, suffix and animation. Colors of the world are stored in eight bits; these are multiples of
# 1/255, so that nothing is lost.
WRITTEN = {
    "still usda": (ABSORBING, "usda", False),
    "animated usda": (ABSORBING, "usda", True),
    "animated usdc": (ABSORBING, "usdc", True),
    "animated usdz": (ABSORBING, "usdz", True),
    "sun and sky": (scattering(lights=(Sun((0.4, -0.5, 0.8), (3.0, 2.0, 1.0), 0.2),), sky=(0.2, 0.4, 0.8)), "usda", False),
    "sphere and rectangle": (
        scattering(lights=(Sphere((2.6, 2.8, 2.4), 0.4, (8.0, 6.0, 4.0)), Rectangle((1.0, 1.0, 3.2), (0.2, 0.1, -1.0), (1.5, 0.8), (4.0, 5.0, 6.0)))),
        "usdc", False,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", WRITTEN)
def test_stages_of_blender(fixtures, alike, tmp_path, name):
    settings, suffix, animated = WRITTEN[name]
    stage = blender.Stage(settings, fixtures / "plume.vdb")
    # The second frame of the sequence is the plume; the first one has something else.
    for number, vdb in ((1, fixtures / "cube.vdb"), (2, stage.medium.data.filepath)):
        shutil.copy(vdb, tmp_path / f"plume.{number:04d}.vdb")
    if animated:
        data = stage.medium.data
        data.filepath, data.is_sequence = str(tmp_path / "plume.0001.vdb"), True
        data.frame_duration, data.frame_start = 2, 1
        stage.scene.frame_start, stage.scene.frame_end = 1, 2
    stage.scene.frame_set(2)
    camera = place_camera(stage.scene, VIEW, 0.01)
    path = tmp_path / f"stage.{suffix}"
    with quiet():
        bpy.ops.wm.usd_export(filepath=str(path), export_animation=animated)
    bpy.data.cameras.remove(camera.data)
    if suffix == "usda" and animated:
        assert "filePath.timeSamples" in path.read_text()
    frames = ("--frames", "2") if animated else ()
    # All that absorb show one plume, in their second frame or the only one.
    kind = "absorbing" if settings is ABSORBING else name.replace(" ", "_")
    alike(volume(fixtures / "plume.vdb", VIEW, settings, name=f"usd_{kind}"), path, settings, *frames)


def camera_text(more=""):
    """A camera whose window is that of `VIEW`, in its own axes, with its matrix as USD writes it."""
    aperture = 36.0
    per_pixel = aperture / WIDTH
    matrix = ", ".join("(" + ", ".join(str(v) for v in row) + ")" for row in VIEW.camera_to_world.T.tolist())
    return f"""
    def Camera "camera" {{
        float horizontalAperture = {aperture}
        float verticalAperture = {aperture * HEIGHT / WIDTH}
        float horizontalApertureOffset = {(WIDTH / 2 - VIEW.cx) * per_pixel}
        float verticalApertureOffset = {(VIEW.cy - HEIGHT / 2) * per_pixel}
        float focalLength = {VIEW.fl_x * per_pixel}
        float2 clippingRange = (0.01, 1000)
        matrix4d xformOp:transform = ({matrix})
        uniform token[] xformOpOrder = ["xformOp:transform"]
        {more}
    }}
"""


def volume_text(file, more="", attribute="asset filePath = {}"):
    return f"""
    def Volume "smoke" {{
        rel field:density = <density>
        {more}
        def OpenVDBAsset "density" {{
            token fieldName = "density"
            {attribute.format(f"@{file}@")}
        }}
    }}
"""


def header(axis, meters, more=""):
    return f'#usda 1.0\n(\n    upAxis = "{axis}"\n    metersPerUnit = {meters}\n    timeCodesPerSecond = 24\n    {more}\n)\n'


ORDER = 'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]'
# A turn, a move and a scale of everything, and of the volume within.
WORLD = f"double3 xformOp:translate = (0.3, -0.2, 0.1)\n float3 xformOp:rotateXYZ = (20, -35, 50)\n float3 xformOp:scale = (1, 1, 1)\n {ORDER}"
INNER = f"double3 xformOp:translate = (0.4, 0.1, -0.1)\n float3 xformOp:rotateXYZ = (5, 15, -25)\n float3 xformOp:scale = (0.9, 1.1, 0.8)\n {ORDER}"
MOVING = """double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 5: (0.8, 0.4, -0.4) }
 float xformOp:rotateZ.timeSamples = { 1: 0, 5: 40 }
 uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateZ"]"""
LIGHTS = """
    def SphereLight "lamp" {
        float inputs:intensity = 60
        float inputs:radius = 0.4
        bool inputs:normalize = 1
        color3f inputs:color = (1, 0.7, 0.4)
        double3 xformOp:translate = (2.6, 2.8, 2.4)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def DomeLight "sky" {
        asset inputs:texture:file = @./sky.exr@
        float inputs:intensity = 1.5
        double3 xformOp:rotateXYZ = (0, 40, 0)
        uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
    }
"""


def world(content, more=""):
    return f'def Xform "World" {{\n    {more}\n{content}}}\n'


def stages(vdb):
    """Length of a unit in meters, text of a stage, the time code that is shown, and further layers, by its name."""
    referenced = header("Z", 1, 'defaultPrim = "smoke"') + volume_text(vdb)
    sampled = volume_text(vdb, attribute="asset filePath.timeSamples = {{ 1: @./smoke.0001.vdb@, 2: @./smoke.0002.vdb@ }}")
    return {
        "y-up cm, nested": (0.01, header("Y", 0.01) + world(camera_text() + volume_text(vdb, INNER), WORLD), None, {}),
        "z-up m, nested": (1, header("Z", 1) + world(camera_text() + volume_text(vdb, INNER), WORLD), None, {}),
        "y-up m": (1, header("Y", 1) + camera_text() + volume_text(vdb), None, {}),
        "time-sampled transform": (1, header("Z", 1, "startTimeCode = 1\n endTimeCode = 5") + camera_text() + volume_text(vdb, MOVING), 4, {}),
        "time-sampled files": (0.01, header("Y", 0.01, "startTimeCode = 1\n endTimeCode = 2") + camera_text() + sampled, 2, {}),
        "reference": (
            1, header("Z", 1) + camera_text() + f'def "a" (prepend references = @./other.usda@) {{\n {MOVING}\n}}\n',
            3, {"other.usda": referenced},
        ),
    }  # fmt: skip


def by_blender(stage, settings, meters, frame, seed):
    """The picture of a stage that Blender imports, its volumes of a medium as `settings` say in units of the stage."""
    in_meters = dataclasses.replace(settings, density_scale=settings.density_scale / meters)
    scene = empty_scene()
    prepare_scene(scene, in_meters)
    with quiet():
        bpy.ops.wm.usd_import(filepath=str(stage))
    scene.camera = next(thing for thing in bpy.data.objects if thing.type == "CAMERA")
    for thing in bpy.data.objects:
        if thing.type == "VOLUME":
            thing.data.render.precision, thing.data.render.space, thing.data.render.clipping = "FULL", "WORLD", 0.0
            thing.data.materials.clear()
            thing.data.materials.append(medium_material(in_meters, "density"))
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    scene.frame_set(frame or 0)
    scene.cycles.seed = seed
    with quiet():
        scene.render.filepath = str(pathlib.Path(stage).with_name("film.exr"))
        bpy.ops.render.render(write_still=True)
    return read_exr(scene.render.filepath)


def of_cycles(name, vdb, text, stage, settings, meters, frame=None):
    """Cycles' pictures as a reference of a stage that holds `text` and shows the volume `vdb`, padded."""
    film = functools.partial(by_blender, stage, settings, meters, frame)
    kept = f"usd_{re.sub(r'[^a-z0-9]+', '_', name)}"
    return reference.of_cycles(kept, film, [vdb, __file__], stage=text, settings=settings, meters=meters, frame=frame)


ENCODED = [(name, "usda") for name in stages("")] + [("y-up cm, nested", "usdc"), ("time-sampled files", "usdz")]


@pytest.mark.parametrize("name, suffix", ENCODED)
def test_stages_of_others(fixtures, alike, tmp_path, name, suffix):
    plume = fixtures / "plume.vdb"
    vdb = padding.padded_copy(plume, ["density"], tmp_path).name
    shutil.copy(fixtures / "cube.vdb", tmp_path / "smoke.0001.vdb")
    shutil.copy(tmp_path / vdb, tmp_path / "smoke.0002.vdb")
    meters, text, frame, layers = stages(f"./{vdb}")[name]
    for layer, content in layers.items():
        (tmp_path / layer).write_text(content)
    source = tmp_path / "stage.usda"
    source.write_text(text)
    path = tmp_path / f"stage.{suffix}"
    if suffix == "usdc":
        Usd.Stage.Open(str(source)).Export(str(path))
    elif suffix == "usdz":
        assert UsdUtils.CreateNewUsdzPackage(str(source), str(path))
    frames = () if frame is None else ("--frames", frame)
    # Whatever the encoding, Blender reads the text.
    alike(of_cycles(name, plume, text, source, ABSORBING, meters, frame), path, ABSORBING, *frames)


@pytest.mark.parametrize("axis", ["Y", "Z"])
def test_lights_of_others(fixtures, alike, tmp_path, axis):
    """A sphere of a given power, and a dome whose picture is brighter to one side and above."""
    plume = fixtures / "plume.vdb"
    vdb = padding.padded_copy(plume, ["density"], tmp_path).name
    turn, rise = np.meshgrid((np.arange(64) + 0.5) / 64, (np.arange(32) + 0.5) / 32)
    glow = 6.0 * np.exp(-((turn - 0.2) ** 2 + (rise - 0.35) ** 2) / 0.01)
    sky = np.stack([0.1 + glow, 0.1 + 0.4 * turn, np.where(rise < 0.5, 0.8, 0.1), np.ones_like(turn)], axis=-1)
    write_exr(tmp_path / "sky.exr", sky.astype(np.float32), "test", {})
    source = tmp_path / "stage.usda"
    text = header(axis, 1) + camera_text() + volume_text(f"./{vdb}") + LIGHTS
    source.write_text(text)
    settings = scattering(samples=128)
    alike(of_cycles(f"lights_{axis.lower()}", plume, text, source, settings, 1.0), source, settings)
