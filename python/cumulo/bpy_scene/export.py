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
from .cameras import far_complaint, sees
from .lights import light_entry
from .refusal import Complaint, Complaints, named
from .shutter import blurred_camera, goes_with_velocities, keyed
from .surfaces import Surfaces
from .visible import SURFACES, placed_objects
from .volumes import check_handedness, inside_complaint, lattice_of, shows_nothing, vdb_of, volume_entry
from .world import Worlds


@dataclasses.dataclass(frozen=True)
class Export:
    """What an export wrote, and how `cumulo render` renders it as the scene says.

    `scene` is a scene file, or one for each frame, `scene.####.json`; `cameras` is a `transforms.json` whose pictures bear
    the numbers of `frames`. `options` are those that neither states: bounces and background. `left_out` says in words what
    Cumulo cannot honor and the export does without.
    """

    scene: pathlib.Path
    cameras: pathlib.Path
    frames: tuple
    options: tuple
    left_out: tuple = ()

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


def export(folder, scene=None, frames=None, ignore=False):
    """Writes a scene's volumes, meshes, lights and world as scene files, and its camera as `transforms.json`, into `folder`.

    `scene` is the present one unless given; `frames` are numbers in equal steps, by default the present frame alone.
    The present frame alone is written with its subframe. Returns the Export. Raises Refused where Cumulo would show something
    else than Cycles, with all that is wrong about the scene, each by the object and the node, and ValueError for frames that
    it cannot number. With `ignore` it leaves out what the picture of the volumes can do without, such as reflections, lights
    that Cumulo does not have and blur, and records that in the Export and the files; it raises Refused about the rest.
    """
    return finish(export_steps(folder, scene, frames, ignore))


def export_steps(folder, scene=None, frames=None, ignore=False):
    """What `export` does, frame by frame: a generator of (frames done, frames) that returns the Export."""
    scene, folder = scene or bpy.context.scene, pathlib.Path(folder)
    frames = (scene.frame_current,) if frames is None else tuple(frames)
    steps = {b - a for a, b in zip(frames, frames[1:])}
    if not frames or len(steps) > 1 or min(frames) < 0 or any(step < 1 for step in steps):
        raise ValueError(f"frames {frames}: numbers from 0 on in equal steps are needed")
    subframe = scene.frame_subframe if frames == (scene.frame_current,) else 0.0
    described, views, left_out, worlds, surfaces = [], [], {}, Worlds(folder), Surfaces(folder)
    with frame_kept(scene):
        for frame in frames:
            scene.frame_set(frame, subframe=subframe)
            document, camera, without = describe(folder, scene, ignore, worlds, surfaces)
            surfaces.write()
            # What is left out of several frames is named once.
            left_out |= dict.fromkeys(without)
            described.append(document)
            views.append((camera, folder / f"frame.{frame:04}.exr"))
            yield len(views), len(frames)
    folder.mkdir(parents=True, exist_ok=True)
    worlds.write()
    one = all(document == described[0] for document in described)
    name = "scene.json" if one else "scene.####.json"
    noted = {"left_out": list(left_out)} if left_out else {}
    for frame, document in list(zip(frames, described))[: 1 if one else None]:
        write_json(folder / name.replace("####", f"{frame:04}"), document | noted)
    capture = Capture(views, model="scattering", background=(0.0, 0.0, 0.0), pixel_filter="box", extra=noted)
    capture.write(folder / "transforms.json")
    options = _options(scene, any("meshes" in document for document in described))
    return Export(folder / name, folder / "transforms.json", frames, options, tuple(left_out))


def describe(folder, scene=None, ignore=False, worlds=None, surfaces=None):
    """A scene file in `folder` as a dict, the Camera, and in words what is left out, of a scene at its present frame. Raises
    as `export` does. `worlds` and `surfaces` are those of the frames before."""
    scene, complaints = scene or bpy.context.scene, Complaints(ignore)
    for complaint in _complaints_of(scene):
        complaints.add(complaint)
    camera, placed, motions = None, (), {}
    with complaints.gathered():
        camera, motions = blurred_camera(scene, complaints)
    with complaints.gathered():
        placed = placed_objects(scene, complaints)
    fps = scene.render.fps / scene.render.fps_base
    volumes, lights, meshes, count = [], [], [], 0
    surfaces = surfaces or Surfaces(folder)
    for key, each in keyed(placed):
        with complaints.gathered():
            if each.object.type in SURFACES:
                if complaint := inside_complaint(each.object):
                    complaints.add(complaint)
                else:
                    meshes += [entry | _motion(motions.get(key)) for entry in surfaces.entries(each, complaints)]
            elif each.object.type == "LIGHT":
                if entry := light_entry(each, complaints):
                    if camera and (complaint := _seen_complaint(each.object, entry, camera)):
                        complaints.add(complaint)
                    lights.append(entry)
            elif not shows_nothing(each.object):
                count += 1
                entry = volume_entry(each, folder, fps)
                lattice, box = lattice_of(each, vdb_of(each), entry["grid"])
                check_handedness(each, lattice)
                if camera and (complaint := far_complaint(scene, camera, padding.world_box(lattice, box))):
                    complaints.add(complaint)
                if scene.render.use_motion_blur and not goes_with_velocities(each.object):
                    entry.pop("velocity", None)
                volumes.append(entry | _motion(motions.get(key)))
    # A volume that is not evaluated is complained about already.
    if not (count or complaints.stops):
        complaints.add(
            Complaint(
                named("scene", scene),
                f"it renders no volume at frame {scene.frame_current}",
                "add one (Add > Volume > Import OpenVDB), or choose other frames",
            )
        )
    if scene.world:
        with complaints.gathered():
            world = (worlds or Worlds(folder)).lights(scene, complaints)
            if complaint := _sun_complaint(scene, world, camera):
                complaints.add(complaint)
            lights += world
    if meshes and (complaint := _bounces_complaint(scene)):
        complaints.add(complaint)
    complaints.settle()
    with_meshes = {"meshes": meshes} if meshes else {}
    return {"volumes": volumes, "lights": lights} | with_meshes, camera, complaints.left_out


def _motion(matrices):
    """Keys of an entry of a scene file for the motion of an object: matrices as the shutter opens, in the middle and as it
    closes, or None."""
    names = ("transform_start", "transform", "transform_end")
    return {name: matrix.tolist() for name, matrix in zip(names, matrices)} if matrices else {}


def _complaints_of(scene):
    """The complaints about settings of the scene that change what it shows."""
    where = named("scene", scene)
    if (exposure := scene.cycles.film_exposure) != 1.0:
        yield Complaint(
            where,
            f"its film exposure is {exposure:g}",
            "set it to 1 (Render Properties > Film)",
            "the pictures have the exposure 1",
        )
    if scene.render.use_simplify and scene.render.simplify_volumes != 1.0:
        yield Complaint(
            where,
            "Simplify lowers the resolution of volumes",
            "switch Simplify off (Render Properties)",
            "volumes have their full resolution",
        )
    if scene.cycles.use_fast_gi:
        yield Complaint(
            where,
            "Fast GI replaces light of later bounces",
            "switch it off (Render Properties > Light Paths)",
            "the light of later bounces is traced",
        )
    if scene.world is None:
        yield Complaint(
            where,
            "it has no world, without which Cycles shows no volumes",
            "add one, black if need be (World Properties)",
        )


def _bounces_complaint(scene):
    """The Complaint about limits of bounces that differ between surfaces and volumes, or None."""
    cycles = scene.cycles
    limits = [min(cycles.max_bounces, bounces) for bounces in (cycles.diffuse_bounces, cycles.volume_bounces)]
    if scene.render.engine != "CYCLES" or limits[0] == limits[1] == cycles.max_bounces:
        return None
    return Complaint(
        named("scene", scene),
        f"it has {cycles.max_bounces} bounces in all, {cycles.diffuse_bounces} of surfaces, {cycles.volume_bounces} of volumes",
        "give all the same number (Render Properties > Light Paths)",
        f"paths have {max(limits)} bounces, of surfaces and volumes alike",
    )


def _seen_complaint(thing, entry, camera):
    """The Complaint about a light that the camera would see, for Cumulo's are not seen, or None."""
    if not (thing.visible_camera and _is_seen(entry, camera)):
        return None
    return Complaint(
        named("light", thing),
        "the camera sees it, and Cumulo does not show lights",
        "switch its ray visibility Camera off (Object > Visibility)",
        "the light shines, and the picture does not show it",
    )


def _sun_complaint(scene, world, camera):
    """The Complaint about a sun of the world's entries that the camera would see, or None."""
    if camera is None or "--background" in _options(scene):
        return None
    if not any(entry["type"] == "DistantLight" and _is_seen(entry, camera) for entry in world):
        return None
    return Complaint(
        named("world", scene.world),
        "the camera sees the disc of its sun, and Cumulo does not show lights",
        "switch Sun Disc off, or Transparent on (Render Properties > Film)",
        "the sun shines, and the picture does not show it",
    )


def _is_seen(entry, camera):
    """True if the camera sees a light of a scene file."""
    if entry["type"] == "SphereLight":
        centre, radius = entry["centre"], entry["radius"]
    elif entry["type"] == "SpotLight" and entry["radius"] > 0:
        centre, radius = entry["position"], entry["radius"]
    elif entry["type"] == "RectLight":
        across = np.array(entry["edges"]).sum(axis=0)
        centre, radius = np.array(entry["corner"]) + 0.5 * across, 0.5 * np.linalg.norm(across)
    elif entry["type"] == "DistantLight" and entry["angle"] > 0:
        far = 1e6
        centre = camera.camera_to_world[:3, 3] + far * np.array(entry["direction"])
        radius = far * math.sin(math.radians(0.5 * entry["angle"]))
    else:
        return False
    return sees(camera, centre, radius)


def _options(scene, meshes=False):
    """Options of `cumulo render` for what scene files do not state; `meshes` is true of scenes with surfaces."""
    options = []
    if scene.render.engine == "CYCLES":
        # Cycles counts scatterings after the first.
        bounces = max(scene.cycles.volume_bounces, scene.cycles.diffuse_bounces if meshes else 0)
        options += ["--max-bounces", str(1 + min(scene.cycles.max_bounces, bounces))]
    if scene.render.film_transparent or not scene.world.cycles_visibility.camera:
        options += ["--background", "0,0,0"]
    return tuple(options)


def write_json(path, document):
    """Writes JSON, whole or not at all."""
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".writing-") as folder:
        draft = pathlib.Path(folder) / path.name
        draft.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")
        os.replace(draft, path)
