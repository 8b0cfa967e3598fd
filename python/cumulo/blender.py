"""Renders volumes with Blender's Cycles, as a reference (needs `bpy` 5.0.1).

    python -m cumulo.blender render smoke.vdb --capture DIR/transforms.json -o OUT
    python -m cumulo.blender render smoke.vdb --views 32 --size 128x128 -o OUT
    python -m cumulo.blender load reconstructed.vdb

`render` writes one single-part 32-bit float EXR a view, and `transforms.json`. All that would make a
picture prettier than the integral it stands for is off: denoising, adaptive sampling, clamping,
clipping, view transforms.
"""

import argparse
import contextlib
import dataclasses
import json
import os
import pathlib
import sys
import tempfile

import bpy
import numpy as np
from mathutils import Matrix, Vector

bpy.utils.expose_bundled_modules()
from cumulo import padding  # noqa: E402  needs what was just exposed
from cumulo.capture import Capture, sphere_cameras  # noqa: E402
from cumulo.exr import read_exr, write_exr  # noqa: E402


@dataclasses.dataclass(frozen=True)
class Settings:
    """How Cycles renders. `density_scale` is extinction per unit of density and world length;
    `emission` the source radiance per channel of the emission-absorption model. `unbiased` walks by
    null-collision tracking; the biased walk marches with steps of `step_rate` voxels. `pixel_filter`
    is "box", the mean over the pixel's square, or "point": exactly its centre with one sample, and
    within 0.005 pixels of it for all but about one sample in a thousand with more.

    The model "scattering" is a Principled Volume of `albedo` and `anisotropy`, lit by a constant `sky`
    or an equirectangular EXR, `sky_file`, and by `lights`, and seen before black; light is scattered `max_bounces` times at most.
    `function` holds pairs of a density and its share of the extinction, linear in between, for densities from 0 to 1.
    The grid `emission_grid` emits `emission` per unit, and `blackbody` is the intensity of a grid "temperature", in units of
    `kelvin`."""

    model: str = "absorption"
    density_scale: float = 1.0
    emission: tuple = (1.0, 1.0, 1.0)
    background: tuple = (1.0, 1.0, 1.0)
    near: float = 0.0
    pixel_filter: str = "box"
    samples: int = 32
    seed: int = 0
    unbiased: bool = False
    step_rate: float = 0.3
    threads: int = 0
    albedo: tuple = (0.0, 0.0, 0.0)
    anisotropy: float = 0.0
    absorption_color: tuple = (0.0, 0.0, 0.0)
    emission_grid: str = ""
    blackbody: float = 0.0
    kelvin: float = 1000.0
    function: tuple = ()
    sky: tuple = (0.0, 0.0, 0.0)
    sky_file: str = ""
    lights: tuple = ()
    max_bounces: int = 1024


@dataclasses.dataclass(frozen=True)
class Sun:
    """A sun seen in `direction` (from the scene), `angle` radians across, with this irradiance."""

    direction: tuple
    irradiance: tuple = (1.0, 1.0, 1.0)
    angle: float = 0.0

    def link(self):
        data = bpy.data.lights.new("sun", "SUN")
        data.angle = self.angle
        _set_power(data, self.irradiance)
        _link("sun", data, _facing(-np.asarray(self.direction, float), (0, 0, 0)))


@dataclasses.dataclass(frozen=True)
class Sphere:
    """A sphere that emits outwards; Blender's point light with a radius. Seen from far away, one of
    radius 0 and one of any radius with the same intensity are alike."""

    centre: tuple
    radius: float
    radiance: tuple = (1.0, 1.0, 1.0)

    def link(self):
        data = bpy.data.lights.new("sphere", "POINT")
        data.shadow_soft_size = self.radius
        # Else what lies near the light gets less.
        data.use_soft_falloff = False
        # Power over the area and over pi is radiance.
        _set_power(data, [4 * np.pi**2 * self.radius**2 * c for c in self.radiance])
        place = np.eye(4)
        place[:3, 3] = self.centre
        _link("sphere", data, place)


@dataclasses.dataclass(frozen=True)
class Rectangle:
    """A rectangle at `centre` that emits along `direction`; `size` is along its own x and y."""

    centre: tuple
    direction: tuple
    size: tuple
    radiance: tuple = (1.0, 1.0, 1.0)

    def link(self):
        data = bpy.data.lights.new("rectangle", "AREA")
        data.shape, (data.size, data.size_y) = "RECTANGLE", self.size
        _set_power(data, [np.pi * self.size[0] * self.size[1] * c for c in self.radiance])
        _link("rectangle", data, self.matrix())

    def matrix(self):
        """Object to world; light leaves along -Z."""
        return _facing(np.asarray(self.direction, float), self.centre)


def _facing(direction, centre):
    """A matrix whose -Z is `direction`."""
    back = -direction / np.linalg.norm(direction)
    side = np.cross((0.0, 1.0, 0.0) if abs(back[1]) < 0.9 else (1.0, 0.0, 0.0), back)
    side /= np.linalg.norm(side)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2], matrix[:3, 3] = side, np.cross(back, side), back, centre
    return matrix


def _set_power(data, color):
    """Sets a light's power by channel, and hides it from the camera and from shadows."""
    most = max(color)
    data.energy = most
    data.color = [c / most for c in color]
    data.use_shadow = True
    data.cycles.max_bounces = 1024


@contextlib.contextmanager
def _quiet():
    """Blender tells of every file it saves on the process's stdout, which is for results."""
    sys.stdout.flush()
    saved = os.dup(1)
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(saved, 1)
        os.close(saved)


def _new_scene(settings):
    with _quiet():
        bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples = settings.samples
    cycles.seed = settings.seed
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.sample_clamp_direct = 0.0
    cycles.sample_clamp_indirect = 0.0
    cycles.light_sampling_threshold = 0.0
    # Pixels independent of each other (blue noise would tie neighbours), so that their spread tells
    # the standard error of a mean.
    cycles.sampling_pattern = "TABULATED_SOBOL"
    # Cycles counts scatterings after the first.
    cycles.max_bounces = cycles.volume_bounces = max(0, settings.max_bounces - 1) if settings.model == "scattering" else 0
    cycles.caustics_reflective = cycles.caustics_refractive = True
    cycles.transparent_max_bounces = 1024
    if settings.pixel_filter == "box":
        cycles.pixel_filter_type = "BOX"
    else:
        # The narrowest that Cycles takes.
        cycles.pixel_filter_type = "BLACKMAN_HARRIS"
        cycles.filter_width = 0.01
    cycles.volume_biased = not settings.unbiased
    cycles.volume_step_rate = settings.step_rate
    cycles.volume_max_steps = 65536
    render = scene.render
    if settings.threads:
        render.threads_mode, render.threads = "FIXED", settings.threads
    render.resolution_percentage = 100
    render.use_compositing = False
    render.use_sequencer = False
    # Views of one volume follow each other: its upload is kept.
    render.use_persistent_data = True
    # The film gets emission and transmittance; the background is laid behind afterwards, which is
    # the same to a constant one and tells alpha besides.
    render.film_transparent = True
    scene.view_settings.view_transform = "Raw"
    image = render.image_settings
    image.media_type = "MULTI_LAYER_IMAGE"
    image.file_format = "OPEN_EXR_MULTILAYER"
    image.color_depth = "32"
    image.exr_codec = "ZIP"
    image.use_exr_interleave = True
    scene.world = bpy.data.worlds.new("world")
    if settings.model == "scattering":
        tree = scene.world.node_tree
        tree.nodes.clear()
        background, surface = (tree.nodes.new(kind) for kind in ("ShaderNodeBackground", "ShaderNodeOutputWorld"))
        background.inputs["Color"].default_value = (*settings.sky, 1)
        if settings.sky_file:
            texture = tree.nodes.new("ShaderNodeTexEnvironment")
            texture.image = bpy.data.images.load(settings.sky_file)
            texture.image.colorspace_settings.name = "Linear Rec.709"
            tree.links.new(texture.outputs["Color"], background.inputs["Color"])
        tree.links.new(background.outputs[0], surface.inputs["Surface"])
        for light in settings.lights:
            light.link()
    return scene


def _density_nodes(tree, grid, factor):
    """Output socket of `factor` times the grid's value; the float `factor` when there is no grid."""
    scale = tree.nodes.new("ShaderNodeMath")
    scale.operation = "MULTIPLY"
    scale.inputs[1].default_value = factor
    if grid is None:
        scale.inputs[0].default_value = 1.0
    else:
        attribute = tree.nodes.new("ShaderNodeAttribute")
        attribute.attribute_name = grid
        tree.links.new(attribute.outputs["Fac"], scale.inputs[0])
    return scale.outputs[0]


def _function_nodes(tree, grid, settings):
    """Output socket of the settings' function of the grid's value, times their density scale."""
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    stops = ramp.color_ramp.elements
    while len(stops) < len(settings.function):
        stops.new(0.5)
    for stop, (density, share) in zip(stops, settings.function):
        stop.position, stop.color = density, (share, share, share, 1)
    tree.links.new(_density_nodes(tree, grid, 1.0), ramp.inputs["Fac"])
    scale = tree.nodes.new("ShaderNodeMath")
    scale.operation = "MULTIPLY"
    scale.inputs[1].default_value = settings.density_scale
    tree.links.new(ramp.outputs["Color"], scale.inputs[0])
    return scale.outputs[0]


def _material(settings, grid):
    """Grey absorption, and the emission that keeps a constant source radiance: the emission density
    is extinction times that radiance."""
    material = bpy.data.materials.new("medium")
    tree = material.node_tree
    tree.nodes.clear()
    surface = tree.nodes.new("ShaderNodeOutputMaterial")
    if settings.model == "scattering":
        medium = tree.nodes.new("ShaderNodeVolumePrincipled")
        medium.inputs["Color"].default_value = (*settings.albedo, 1)
        medium.inputs["Anisotropy"].default_value = settings.anisotropy
        medium.inputs["Absorption Color"].default_value = (*settings.absorption_color, 1)
        medium.inputs["Density Attribute"].default_value = ""
        if any(settings.emission):
            emitting = (settings.emission_grid, 1.0) if settings.emission_grid else (grid, settings.density_scale)
            medium.inputs["Emission Color"].default_value = (*settings.emission, 1)
            tree.links.new(_density_nodes(tree, *emitting), medium.inputs["Emission Strength"])
        if settings.blackbody:
            medium.inputs["Blackbody Intensity"].default_value = settings.blackbody
            medium.inputs["Temperature"].default_value = settings.kelvin
        density = _density_nodes(tree, grid, settings.density_scale)
        if settings.function:
            density = _function_nodes(tree, grid, settings)
        tree.links.new(density, medium.inputs["Density"])
        tree.links.new(medium.outputs[0], surface.inputs["Volume"])
        return material
    medium = tree.nodes.new("ShaderNodeVolumeAbsorption")
    medium.inputs["Color"].default_value = (0, 0, 0, 1)
    tree.links.new(_density_nodes(tree, grid, settings.density_scale), medium.inputs["Density"])
    if settings.model == "emission-absorption":
        emission = tree.nodes.new("ShaderNodeEmission")
        emission.inputs["Color"].default_value = (*settings.emission, 1)
        tree.links.new(_density_nodes(tree, grid, settings.density_scale), emission.inputs["Strength"])
        both = tree.nodes.new("ShaderNodeAddShader")
        tree.links.new(medium.outputs[0], both.inputs[0])
        tree.links.new(emission.outputs[0], both.inputs[1])
        medium = both
    tree.links.new(medium.outputs[0], surface.inputs["Volume"])
    return material


def _link(name, data, matrix=None):
    thing = bpy.data.objects.new(name, data)
    bpy.context.collection.objects.link(thing)
    if matrix is not None:
        thing.matrix_world = Matrix(np.asarray(matrix).tolist())
    return thing


def load_volume(path):
    """Links the VDB at `path` into the current scene, where its own transform puts it. Raises
    ValueError where Blender cannot read it."""
    volume = bpy.data.volumes.new(pathlib.Path(path).stem)
    volume.filepath = str(pathlib.Path(path).resolve())
    volume.render.precision = "FULL"
    volume.render.clipping = 0.0
    volume.render.space = "WORLD"
    if not volume.grids.load():
        raise ValueError(f"{path}: Blender cannot read it: {volume.grids.error_message}")
    return _link("volume", volume)


def box_mesh(low, high, matrix=None):
    """Links a closed box, moved by `matrix`, whose inside is the medium."""
    corners = np.array([[(low, high)[i >> axis & 1][axis] for axis in range(3)] for i in range(8)])
    if matrix is not None:
        # Into the corners, for an object's own matrix loses its shear.
        corners = corners @ np.asarray(matrix)[:3, :3].T + np.asarray(matrix)[:3, 3]
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    mesh = bpy.data.meshes.new("box")
    mesh.from_pydata(corners.tolist(), [], faces)
    return _link("box", mesh)


def _place_camera(camera, near):
    """Blender's lens, sensor shift and pixel aspect for a pinhole or orthographic camera.

    With horizontal fit Blender's view plane at unit distance is, in terms of its pixel size ps =
    sensor/lens/W (orthographic: ortho_scale/W) and ycor = aspect_y/aspect_x,
    x = (px - W/2 + shift_x W) ps, y = ((H/2 - py) ycor + shift_y W) ps; ours is
    x = (px - cx)/fl_x, y = (cy - py)/fl_y.
    """
    data = bpy.data.cameras.new("camera")
    thing = _link("camera", data, camera.camera_to_world)
    width, height = camera.width, camera.height
    y_per_x = camera.fl_x / camera.fl_y
    data.sensor_fit = "HORIZONTAL"
    if camera.orthographic:
        data.type = "ORTHO"
        data.ortho_scale = width / camera.fl_x
    else:
        data.sensor_width = 36.0
        data.lens = data.sensor_width * camera.fl_x / width
    data.shift_x = (width / 2 - camera.cx) / width
    data.shift_y = (camera.cy - height / 2) * y_per_x / width
    data.clip_start = max(near, 1e-6)
    data.clip_end = 1e9
    scene = bpy.context.scene
    # Blender takes aspects from 1 up.
    scene.render.pixel_aspect_x = max(1.0, 1.0 / y_per_x)
    scene.render.pixel_aspect_y = max(1.0, y_per_x)
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.camera = thing
    return thing


class Stage:
    """A scene with one medium in it, ready to be seen by many cameras. Blender knows one scene at a
    time: a new Stage ends the one before."""

    def __init__(self, settings, vdb=None, grid="density", box=None):
        """The medium is the VDB file `vdb`, or homogeneous of density 1 in `box` = (low, high) or
        (low, high, matrix)."""
        self.settings = settings
        self.scene = _new_scene(settings)
        if vdb is None:
            self.medium = box_mesh(*box)
        else:
            self._folder = tempfile.TemporaryDirectory(prefix="cumulo-")
            emitting = [settings.emission_grid or grid, "temperature" if settings.blackbody else grid]
            grids = dict.fromkeys([grid, *emitting])
            self.medium = load_volume(padding.padded_copy(vdb, grids, self._folder.name))
        self.medium.data.materials.append(_material(settings, None if vdb is None else grid))

    def film(self, camera, seed=None):
        """What Cycles puts on film: [height, width, 4] f32, emitted radiance and 1 - T."""
        self.scene.cycles.seed = self.settings.seed if seed is None else seed
        thing = _place_camera(camera, self.settings.near if camera.near is None else camera.near)
        with tempfile.TemporaryDirectory() as folder, _quiet():
            self.scene.render.filepath = str(pathlib.Path(folder) / "film.exr")
            bpy.ops.render.render(write_still=True)
            pixels = read_exr(self.scene.render.filepath)
        bpy.data.cameras.remove(thing.data)
        return pixels

    def picture(self, camera, seed=None):
        """The view before its background: [height, width, 4] f32, radiance and alpha = 1 - T."""
        pixels = self.film(camera, seed)
        pixels[..., :3] += (1.0 - pixels[..., 3:]) * np.asarray(self.settings.background, np.float32)
        return pixels


def render_capture(vdb, cameras, settings, folder, grid="density", progress=None):
    """Renders one view a camera into `folder` and writes its `transforms.json`; returns the Capture.

    Each view has a seed of its own (settings.seed + its number), so that noise does not repeat.
    """
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    matrix, _ = padding.lattice(vdb, grid)
    stage = Stage(settings, vdb, grid)
    software = f"Blender {bpy.app.version_string} Cycles"
    frames = []
    for number, camera in enumerate(cameras):
        picture = folder / f"view_{number:03}.exr"
        pixels = stage.picture(camera, settings.seed + number)
        write_exr(picture, pixels, software, dataclasses.asdict(settings) | {"seed": settings.seed + number})
        # Other keys of the frame are about the picture that it had.
        frames.append((dataclasses.replace(camera, extra={}), picture))
        if progress:
            progress(number + 1, len(cameras))
    capture = Capture(
        frames,
        model=settings.model,
        background=settings.background,
        pixel_filter=settings.pixel_filter,
        near=settings.near,
        density_scale=settings.density_scale,
        emission=settings.emission,
        lattice=matrix,
    )
    capture.write(folder / "transforms.json")
    return capture


def where(path):
    """Loads a VDB into an empty scene and says where Blender puts it: per grid its type, and the
    object's world box; as JSON-ready data."""
    with _quiet():
        bpy.ops.wm.read_factory_settings(use_empty=True)
    volume = load_volume(path)
    bpy.context.view_layer.update()
    corners = np.array([volume.matrix_world @ Vector(corner) for corner in volume.bound_box])
    return {
        "file": str(path),
        "box": [corners.min(0).tolist(), corners.max(0).tolist()],
        "grids": [
            {"name": grid.name, "type": grid.data_type, "lattice": np.array(grid.matrix_object).tolist()}
            for grid in _loaded(volume.data.grids)
        ],
    }


def _loaded(grids):
    for grid in grids:
        grid.load()
        yield grid


def show_progress(done, of):
    """One line on stderr that counts the views, where somebody is watching it."""
    if not sys.stderr.isatty():
        return
    print(f"\rCycles view {done} of {of}", end="" if done < of else "\n", file=sys.stderr, flush=True)


def _settings(options, capture):
    given = {
        key: getattr(options, key)
        for key in ("model", "density_scale", "background", "emission", "samples", "seed", "unbiased", "step_rate", "threads")
        if getattr(options, key) is not None
    }
    for key in ("background", "emission"):
        if key in given:
            given[key] = tuple(given[key])
    if options.albedo is not None:
        # Scattered light is seen before black.
        given |= {"model": "scattering", "background": (0.0, 0.0, 0.0), "albedo": (options.albedo,) * 3}
        given.setdefault("emission", (0.0, 0.0, 0.0))
        given["anisotropy"] = options.anisotropy or 0.0
        given["sky"] = tuple(options.sky or (0.0, 0.0, 0.0))
        given["lights"] = (Sun(tuple(options.sun), (3.0, 3.0, 3.0)),) if options.sun else ()
        if capture:
            given.setdefault("density_scale", capture.density_scale)
            given.setdefault("near", capture.near)
        return Settings(**given)
    if capture:
        for key in ("model", "density_scale", "background", "emission", "near"):
            given.setdefault(key, getattr(capture, key))
        _check_model(capture, given["model"])
    return Settings(**given)


def _check_model(capture, model):
    """Raises ValueError where Cycles would show something else than the pictures of the capture do."""
    if model == "scattering":
        raise ValueError("the capture is of a medium that scatters, which only tests render here; give --model absorption")
    if model == "pre-shaded":
        raise ValueError("the capture is of a pre-shaded volume, which is not rendered here; give --model")
    if model == "emission-absorption" and capture.transfer is not None:
        raise ValueError("the capture has a transfer function, which is not rendered here; give --model absorption")
    if model == "emission-absorption" and capture.emission_model != "grey":
        raise ValueError(
            f"the capture's emission_model is {capture.emission_model!r}, and only 'grey' is rendered here;"
            " give --model absorption"
        )


def _frames(text):
    first, _, last = text.partition("-")
    return int(first), int(last or first)


def _size(text):
    width, height = text.lower().split("x")
    return int(width), int(height)


def main(arguments=None):
    """The command line; see the top of this file."""
    parser = argparse.ArgumentParser(prog="python -m cumulo.blender", description="Cycles renders of VDB volumes")
    commands = parser.add_subparsers(dest="command", required=True)
    render = commands.add_parser("render", help="render a VDB to EXRs and transforms.json")
    render.add_argument("vdb")
    cameras = render.add_mutually_exclusive_group(required=True)
    cameras.add_argument("--capture", help="take cameras, and what is not given here, from this transforms.json")
    cameras.add_argument("--views", type=int, help="this many views on a sphere around the volume")
    render.add_argument("--size", type=_size, default=(128, 128), metavar="WxH", help="of --views (128x128)")
    render.add_argument("-o", "--output", required=True, metavar="DIR")
    render.add_argument("--grid", default="density")
    render.add_argument("--model", choices=("absorption", "emission-absorption"))
    render.add_argument("--density-scale", type=float, help="extinction per unit of density and world length (1)")
    render.add_argument("--background", type=float, nargs=3, metavar=("R", "G", "B"))
    render.add_argument("--emission", type=float, nargs=3, metavar=("R", "G", "B"), help="source radiance")
    render.add_argument("--samples", type=int, help="per pixel (32)")
    render.add_argument("--seed", type=int)
    render.add_argument("--unbiased", action="store_true", default=None, help="null-collision tracking, noisier")
    render.add_argument("--step-rate", type=float, help="steps of the biased walk, in voxels (0.3)")
    render.add_argument("--threads", type=int)
    render.add_argument("--frames", type=_frames, metavar="A-B", help="of --capture, counted from 0 (all)")
    render.add_argument("--albedo", type=float, help="scatter light: share of the extinction that is scattered")
    render.add_argument("--anisotropy", type=float)
    render.add_argument("--sun", type=float, nargs=3, metavar=("X", "Y", "Z"), help="vector from the volume towards a sun")
    render.add_argument("--sky", type=float, nargs=3, metavar=("R", "G", "B"), help="radiance from all around")
    load = commands.add_parser("load", help="say where Blender puts a VDB, as JSON")
    load.add_argument("vdb")
    options = parser.parse_args(arguments)
    if options.command == "load":
        print(json.dumps(where(options.vdb), indent=1))
        return
    capture = Capture.read(options.capture) if options.capture else None
    if capture:
        views = [camera for camera, _ in capture.frames]
        if options.frames:
            first, last = options.frames
            views = views[first : last + 1]
    else:
        box = padding.world_box(*padding.lattice(options.vdb, options.grid))
        views = sphere_cameras(options.views, *box, *options.size)
    render_capture(
        options.vdb,
        views,
        _settings(options, capture),
        options.output,
        options.grid,
        show_progress,
    )


if __name__ == "__main__":
    try:
        main()
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
