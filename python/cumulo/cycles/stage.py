"""A scene with one medium in it, and its pictures."""

import contextlib
import os
import pathlib
import sys
import tempfile

import bpy
import numpy as np

from .. import padding
from ..exr import read_exr
from .materials import medium_material
from .objects import box_mesh, load_volume, place_camera


@contextlib.contextmanager
def quiet():
    """Blender tells of every file it saves on the process's stdout, which is for results."""
    if sys.stdout is None:
        # Blender without a console, on Windows.
        yield
        return
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


def empty_scene():
    """Ends Blender's present session, and returns the scene of a new one."""
    with quiet():
        bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy.context.scene


@contextlib.contextmanager
def scene_beside():
    """A scene beside those that there are. It is removed at the end with what stands in it alone; whatever else Blender's
    data gained meanwhile, by the user's hand or another script's, stays."""
    scene = bpy.data.scenes.new("Cumulo")
    number = scene.session_uid
    try:
        yield scene
    finally:
        # By its number, for an undo takes the scene away, or makes it anew.
        for found in [each for each in bpy.data.scenes if each.session_uid == number]:
            bpy.data.batch_remove(_blocks_of(found))


def _blocks_of(scene):
    """A scene's data blocks: itself, its world, and the objects that stand in no other scene, with their data and materials."""
    things = [thing for thing in scene.objects if len(thing.users_scene) == 1]
    data = [thing.data for thing in things if thing.data]
    materials = [material for block in data for material in getattr(block, "materials", ()) if material]
    blocks = [scene, *things, *data, *materials, *([scene.world] if scene.world else [])]
    return list({block.session_uid: block for block in blocks}.values())


def prepare_scene(scene, settings):
    """Makes Cycles render the integral alone: nothing that would make the picture prettier."""
    scene.render.engine = "CYCLES"
    _prepare_cycles(scene.cycles, settings)
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
        _light(scene, settings)


def _prepare_cycles(cycles, settings):
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
    cycles.max_bounces = cycles.volume_bounces = (
        max(0, settings.max_bounces - 1) if settings.model == "scattering" else 0
    )
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


def _light(scene, settings):
    """Sky and lights."""
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
        light.link(scene)


class Stage:
    """A scene with one medium in it, ready to be seen by many cameras. Unless it stands in a given `scene`, Blender's
    session is a new one, which ends the Stage before."""

    def __init__(self, settings, vdb=None, grid="density", box=None, *, transform=None, scene=None):
        """The medium is the VDB file `vdb`, moved by the matrix `transform`, or homogeneous of density 1 in `box` =
        (low, high) or (low, high, matrix)."""
        self.settings = settings
        self.scene = scene or empty_scene()
        prepare_scene(self.scene, settings)
        if vdb is None:
            self.medium = box_mesh(self.scene, *box)
        else:
            self._folder = tempfile.TemporaryDirectory(prefix="cumulo-")
            emitting = [settings.emission_grid or grid, "temperature" if settings.blackbody else grid]
            grids = dict.fromkeys([grid, *emitting])
            self.medium = load_volume(self.scene, padding.padded_copy(vdb, grids, self._folder.name, transform))
        self.medium.data.materials.append(medium_material(settings, None if vdb is None else grid))

    def film(self, camera, seed=None):
        """What Cycles puts on film: [height, width, 4] f32, emitted radiance and 1 - T."""
        self.scene.cycles.seed = self.settings.seed if seed is None else seed
        thing = place_camera(self.scene, camera, self.settings.near if camera.near is None else camera.near)
        with tempfile.TemporaryDirectory() as folder, quiet():
            self.scene.render.filepath = str(pathlib.Path(folder) / "film.exr")
            bpy.ops.render.render(write_still=True, scene=self.scene.name)
            pixels = read_exr(self.scene.render.filepath)
        bpy.data.cameras.remove(thing.data)
        return pixels

    def picture(self, camera, seed=None):
        """The view before its background: [height, width, 4] f32, radiance and alpha = 1 - T."""
        pixels = self.film(camera, seed)
        pixels[..., :3] += (1.0 - pixels[..., 3:]) * np.asarray(self.settings.background, np.float32)
        return pixels
