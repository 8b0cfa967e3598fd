"""Scenes of Blender as scene files and camera paths."""

import contextlib
import dataclasses
import json
import math
import os
import pathlib
import shlex
import subprocess
import tempfile

import bpy
import numpy as np

from .. import padding
from ..capture import Capture
from ..cycles.views import finish
from .cameras import camera_of, check_far, sees
from .lights import light_entry
from .refusal import Refused, named
from .visible import SURFACES, placed_objects
from .volumes import check_handedness, lattice_of, refuse_surface, shows_nothing, vdb_of, volume_entry
from .world import dome_entry


@dataclasses.dataclass(frozen=True)
class Export:
    """What an export wrote, and how `cumulo render` renders it as the scene says.

    `scene` is a scene file, or one for each frame, `scene.####.json`; `cameras` is a `transforms.json` whose pictures bear
    the numbers of `frames`. `options` are those that neither states: bounces and background.
    """

    scene: pathlib.Path
    cameras: pathlib.Path
    frames: tuple
    options: tuple

    def arguments(self, output, samples=64):
        """Arguments of the program that render all frames into the folder `output`."""
        first, last = self.frames[0], self.frames[-1]
        step = self.frames[1] - first if len(self.frames) > 1 else 1
        numbers = f"{first}-{last}" + (f"x{step}" if step > 1 else "")
        words = [
            "render",
            self.scene,
            "--cameras",
            self.cameras,
            "--frames",
            numbers,
            "--samples",
            samples,
            *self.options,
        ]
        return [str(word) for word in (*words, "-o", output)]

    def command(self, output, samples=64):
        """The command line of `arguments`, quoted for the shell of this system."""
        words = ["cumulo", *self.arguments(output, samples)]
        return subprocess.list2cmdline(words) if os.name == "nt" else shlex.join(words)


@contextlib.contextmanager
def frame_kept(scene):
    """Leaves the scene at the frame that it was at."""
    frame, subframe = scene.frame_current, scene.frame_subframe
    try:
        yield
    finally:
        scene.frame_set(frame, subframe=subframe)


def frames_of(scene):
    """The numbers of the scene's animation."""
    return tuple(range(scene.frame_start, scene.frame_end + 1, scene.frame_step))


def export(folder, scene=None, frames=None):
    """Writes a scene's volumes, lights and world as scene files, and its camera as `transforms.json`, into `folder`.

    `scene` is the present one unless given; `frames` are numbers in equal steps, by default the present frame alone.
    The present frame alone is written with its subframe. Returns the Export. Raises Refused, which names the object and the
    node, where Cumulo would show something else than Cycles, and ValueError for frames that it cannot number.
    """
    return finish(export_steps(folder, scene, frames))


def export_steps(folder, scene=None, frames=None):
    """What `export` does, frame by frame: a generator of (frames done, frames) that returns the Export."""
    scene, folder = scene or bpy.context.scene, pathlib.Path(folder)
    frames = (scene.frame_current,) if frames is None else tuple(frames)
    steps = {b - a for a, b in zip(frames, frames[1:])}
    if not frames or len(steps) > 1 or min(frames) < 0 or any(step < 1 for step in steps):
        raise ValueError(f"frames {frames}: numbers from 0 on in equal steps are needed")
    subframe = scene.frame_subframe if frames == (scene.frame_current,) else 0.0
    described, views = [], []
    with frame_kept(scene):
        for frame in frames:
            scene.frame_set(frame, subframe=subframe)
            document, camera = describe(folder, scene)
            described.append(document)
            views.append((camera, folder / f"frame.{frame:04}.exr"))
            yield len(views), len(frames)
    folder.mkdir(parents=True, exist_ok=True)
    one = all(document == described[0] for document in described)
    name = "scene.json" if one else "scene.####.json"
    for frame, document in list(zip(frames, described))[: 1 if one else None]:
        write_json(folder / name.replace("####", f"{frame:04}"), document)
    Capture(views, model="scattering", background=(0.0, 0.0, 0.0), pixel_filter="box").write(folder / "transforms.json")
    return Export(folder / name, folder / "transforms.json", frames, _options(scene))


def describe(folder, scene=None):
    """A scene file in `folder` as a dict, and the Camera, of a scene at its present frame. Raises as `export` does."""
    scene = scene or bpy.context.scene
    _check_render(scene)
    camera = camera_of(scene)
    fps = scene.render.fps / scene.render.fps_base
    volumes, lights = [], []
    for placed in placed_objects(scene):
        if placed.object.type in SURFACES:
            refuse_surface(placed.object)
        elif placed.object.type == "LIGHT":
            if entry := light_entry(placed):
                _check_unseen(placed.object, entry, camera)
                lights.append(entry)
        elif not shows_nothing(placed.object):
            entry = volume_entry(placed, folder, fps)
            lattice, box = lattice_of(placed, vdb_of(placed), entry["grid"])
            check_handedness(placed, lattice)
            check_far(scene, camera, padding.world_box(lattice, box))
            volumes.append(entry)
    if not volumes:
        raise Refused(
            named("scene", scene),
            f"it renders no volume at frame {scene.frame_current}",
            "add one (Add > Volume > Import OpenVDB), or choose other frames",
        )
    if dome := dome_entry(scene.world, folder):
        lights.append(dome)
    return {"volumes": volumes, "lights": lights}, camera


def _check_render(scene):
    """Refuses settings of the scene that change what it shows."""
    where = named("scene", scene)
    if (exposure := scene.cycles.film_exposure) != 1.0:
        raise Refused(where, f"its film exposure is {exposure:g}", "set it to 1 (Render Properties > Film)")
    if scene.render.use_simplify and scene.render.simplify_volumes != 1.0:
        raise Refused(where, "Simplify lowers the resolution of volumes", "switch Simplify off (Render Properties)")
    if scene.cycles.use_fast_gi:
        raise Refused(where, "Fast GI replaces light of later bounces", "switch it off (Render Properties > Light Paths)")
    if scene.world is None:
        raise Refused(
            where,
            "it has no world, without which Cycles shows no volumes",
            "add one, black if need be (World Properties)",
        )


def _check_unseen(thing, entry, camera):
    """Refuses a light that the camera would see, for Cumulo's are not seen."""
    if not thing.visible_camera:
        return
    if entry["type"] == "SphereLight":
        centre, radius = entry["centre"], entry["radius"]
    elif entry["type"] == "RectLight":
        across = np.array(entry["edges"]).sum(axis=0)
        centre, radius = np.array(entry["corner"]) + 0.5 * across, 0.5 * np.linalg.norm(across)
    elif entry["type"] == "DistantLight" and entry["angle"] > 0:
        far = 1e6
        centre = camera.camera_to_world[:3, 3] + far * np.array(entry["direction"])
        radius = far * math.sin(math.radians(0.5 * entry["angle"]))
    else:
        return
    if sees(camera, centre, radius):
        raise Refused(
            named("light", thing),
            "the camera sees it, and Cumulo does not show lights",
            "switch its ray visibility Camera off (Object > Visibility)",
        )


def _options(scene):
    """Options of `cumulo render` for what scene files do not state."""
    options = []
    if scene.render.engine == "CYCLES":
        # Cycles counts scatterings after the first.
        options += ["--max-bounces", str(1 + min(scene.cycles.max_bounces, scene.cycles.volume_bounces))]
    if scene.render.film_transparent or not scene.world.cycles_visibility.camera:
        options += ["--background", "0,0,0"]
    return tuple(options)


def write_json(path, document):
    """Writes JSON, whole or not at all."""
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".writing-") as folder:
        draft = pathlib.Path(folder) / path.name
        draft.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")
        os.replace(draft, path)
