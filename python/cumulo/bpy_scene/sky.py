"""Worlds as Cycles shows them: pictures of skies that no scene file states, and their suns as lights of their own."""

import dataclasses
import math
import pathlib
import tempfile

import bpy
import numpy as np

from ..capture import look_at
from ..cycles import Settings
from ..cycles.objects import link_object
from ..cycles.stage import prepare_scene, quiet, scene_beside
from ..exr import read_exr, write_exr

# Width and height of pictures of skies, and samples per pixel.
SIZE = (1024, 512)
SAMPLES = 4
# Width and height of pictures of suns, and their angle of view as a multiple of the sun's angle.
SUN_SIZE = (64, 64)
SUN_VIEW = 2.0
# Skies that may have a disc of the sun; Blender 4 has one.
DISCS = ("SINGLE_SCATTERING", "MULTIPLE_SCATTERING", "NISHITA")


@dataclasses.dataclass(frozen=True)
class Sky:
    """A picture of all directions, [height, width, 4] f32, laid out as Blender's Environment Texture, without suns; `suns`
    are entries of a scene file."""

    picture: np.ndarray
    suns: tuple


def render_sky(world, scene):
    """The Sky of a world at the scene's present frame, rendered by Cycles in a scene of its own."""
    with scene_beside() as beside:
        prepare_scene(beside, Settings(samples=SAMPLES, pixel_filter="box"))
        bpy.data.worlds.remove(beside.world)
        beside.world, beside.render.film_transparent = world.copy(), False
        beside.world.cycles_visibility.camera = True
        # No light is drawn from the world, so that no map of where it is bright is needed.
        beside.world.cycles.sampling_method = "NONE"
        beside.frame_set(scene.frame_current, subframe=scene.frame_subframe)
        discs = [node for node in beside.world.node_tree.nodes if _has_disc(node)]
        for node in discs:
            node.sun_disc = False
        picture = _panorama(beside)
        suns = tuple(sun for node in discs if (sun := _sun(beside, node, picture)))
    return Sky(picture, suns)


def write_sky(sky, path):
    """Writes the picture of a Sky as EXR."""
    write_exr(path, sky.picture, "cumulo.bpy_scene", {})


def _has_disc(node):
    return node.bl_idname == "ShaderNodeTexSky" and node.sky_type in DISCS and node.sun_disc


def _sun(scene, node, sky):
    """DistantLight of the disc of a sky's sun, None where it is not seen. `sky` is the picture without it."""
    node.sun_disc = True
    shown = _panorama(scene)
    disc = _luminance(shown - sky)
    if disc.max() <= 0:
        node.sun_disc = False
        return None
    direction = _mean_direction(disc, *_directions(*SIZE))
    view = SUN_VIEW * node.sun_size
    with_disc = _view(scene, direction, view)
    node.sun_disc = False
    radiance = with_disc[..., :3] - _view(scene, direction, view)[..., :3]
    # Directions of pixels, and the solid angles of these: the square of a plane's pixel, seen at an angle.
    edge = math.tan(0.5 * view)
    step = 2 * edge / SUN_SIZE[0]
    x, y = np.meshgrid(*((np.arange(n) + 0.5) * step - edge for n in SUN_SIZE))
    length = np.sqrt(1 + x**2 + y**2)
    rays = np.stack([x, -y, -np.ones_like(x)], axis=-1) / length[..., None] @ _facing(direction)[:3, :3].T
    angles = step**2 / length**3
    direction = _mean_direction(_luminance(radiance), rays, angles)
    irradiance = (radiance * (angles * (rays @ direction))[..., None]).sum(axis=(0, 1))
    return {
        "type": "DistantLight",
        "direction": direction.tolist(),
        "irradiance": np.maximum(irradiance, 0).tolist(),
        "angle": math.degrees(node.sun_size),
    }


def _luminance(picture):
    return np.maximum(picture[..., :3].astype(np.float64) @ (0.2126, 0.7152, 0.0722), 0)


def _mean_direction(weights, directions, angles):
    """Unit vector of the mean of directions, [height, width, 3], weighted by light and solid angle."""
    mean = (directions * (weights * angles)[..., None]).sum(axis=(0, 1))
    return mean / np.linalg.norm(mean)


def _directions(width, height):
    """Directions of the pixels of a sky, and their solid angles: the top is +Z, the middle +X, the left +Y."""
    turn = (0.5 - (np.arange(width) + 0.5) / width) * 2 * np.pi
    rise = (0.5 - (np.arange(height) + 0.5) / height) * np.pi
    turn, rise = np.meshgrid(turn, rise)
    directions = np.stack([np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)], axis=-1)
    return directions, np.cos(rise) * (2 * np.pi / width) * (np.pi / height)


def _facing(direction):
    """Matrix of a camera that looks along a direction."""
    return np.array(look_at((0, 0, 0), direction))


def _panorama(scene):
    """The picture of all directions."""
    data = bpy.data.cameras.new("sky")
    data.type = "PANO"
    # Before Blender 5.0 panoramas were settings of Cycles.
    settings = data if hasattr(data, "panorama_type") else data.cycles
    settings.panorama_type = "EQUIRECTANGULAR"
    # A camera at rest looks down -Z with +Y up; this one looks along +X with +Z up.
    return _film(scene, data, _facing((1, 0, 0)), SIZE)


def _view(scene, direction, angle):
    """A square picture along a direction, `angle` in radians across."""
    data = bpy.data.cameras.new("sun")
    data.sensor_fit, data.angle = "HORIZONTAL", angle
    return _film(scene, data, _facing(direction), SUN_SIZE)


def _film(scene, data, matrix, size):
    thing = link_object(scene, data.name, data, matrix)
    scene.camera = thing
    scene.render.resolution_x, scene.render.resolution_y = size
    with tempfile.TemporaryDirectory() as folder, quiet():
        scene.render.filepath = str(pathlib.Path(folder) / "film.exr")
        bpy.ops.render.render(write_still=True, scene=scene.name)
        pixels = read_exr(scene.render.filepath)
    bpy.data.cameras.remove(data)
    return pixels
