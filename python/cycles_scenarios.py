"""Sequences of `scenarios.py` rendered by Blender's Cycles, and their motion by `cumulo motion`.

    cycles_scenarios.py FOLDER [--samples 4] [--only VOLUME-SCENARIO ...] [--unbiased]

For each sequence in FOLDER, writes frames to FOLDER/VOLUME-SCENARIO-cycles/noisy and their motion to .../motion, and links the
reference of the sequence beside it: pictures of both programs agree but for noise (`python/tests/blender`). Scenarios with a
transfer function are left out, for Cycles' ramps have no counterpart of theirs. Frames that are there are left as they are.
Runs in the environment of Blender (`python/setup.sh bpy`). CUMULO is the program, `cumulo` by default.
"""

import argparse
import math
import os
import pathlib
import subprocess

import numpy as np
import scenarios
from cumulo import blender
from cumulo.capture import Capture
from cumulo.exr import write_exr


def lamps(lights):
    """Lights and sky of a scene as Blender has them."""
    found, sky = [], (0.0, 0.0, 0.0)
    for light in lights:
        match light["type"]:
            case "DomeLight":
                sky = tuple(light["radiance"])
            case "DistantLight":
                found.append(blender.Sun(tuple(light["direction"]), tuple(light["irradiance"]), math.radians(light["angle"])))
            case "PointLight":
                radius = 0.01
                radiance = tuple(i / (math.pi * radius**2) for i in light["intensity"])
                found.append(blender.Sphere(tuple(light["position"]), radius, radiance))
            case "RectLight":
                along, across = (np.array(edge, float) for edge in light["edges"])
                centre = np.array(light["corner"], float) + 0.5 * (along + across)
                size = (np.linalg.norm(across), np.linalg.norm(along))
                found.append(blender.Rectangle(tuple(centre), tuple(np.cross(along, across)), size, tuple(light["radiance"])))
    return tuple(found), sky


def render(folder, name, out, samples, unbiased):
    """Renders the frames of a sequence that are not there, without motion."""
    volume, scenario = name.split("-", 1)
    views = [camera for camera, _ in Capture.read(folder / name / "cameras.json").frames]
    stage, before = None, None
    for t, view in enumerate(views, 1):
        picture = out / f"frame.{t:04}.exr"
        medium, lights, _ = scenarios.frame_of(scenario, scenarios.VOLUMES[volume][1], t)
        found, sky = lamps(lights)
        settings = blender.Settings(
            model="scattering", background=(0.0, 0.0, 0.0), emission=(0.0, 0.0, 0.0), samples=samples, unbiased=unbiased, sky=sky, lights=found,
            density_scale=medium["density_scale"], albedo=tuple(medium["albedo"]), anisotropy=medium["anisotropy"],
        )  # fmt: skip
        if picture.exists():
            continue
        if settings != before:
            stage, before = blender.Stage(settings, folder / f"{volume}.vdb"), settings
        write_exr(picture, stage.picture(view, t), "Blender Cycles", {"samples": samples, "seed": t})


def write_motion(folder, name, out):
    """Writes the motion of the frames that Cycles does not write."""
    volume, scenario = name.split("-", 1)
    scale = scenarios.frame_of(scenario, scenarios.VOLUMES[volume][1], 1)[0]["density_scale"]
    words = ["motion", folder / f"{volume}.vdb", "--cameras", folder / name / "cameras.json", "--density-scale", scale]
    words += ["-o", out / "frame.####.exr", "--overwrite", "--quiet"]
    subprocess.run([os.environ.get("CUMULO", "cumulo"), *map(str, words)], check=True, stdout=subprocess.DEVNULL)


def main():
    """Renders what is not there."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("folder", type=pathlib.Path)
    p.add_argument("--samples", type=int, default=4)
    p.add_argument("--only", nargs="+")
    p.add_argument("--unbiased", action="store_true")
    a = p.parse_args()
    for reference in sorted(a.folder.glob("*/reference")):
        name = reference.parent.name
        known = name.split("-", 1)[0] in scenarios.VOLUMES and name.split("-", 1)[1] in scenarios.SCENARIOS
        if not known or name.endswith("-transfer") or (a.only and name not in a.only):
            continue
        out = a.folder / f"{name}-cycles"
        for part in ("noisy", "motion"):
            (out / part).mkdir(parents=True, exist_ok=True)
        render(a.folder, name, out / "noisy", a.samples, a.unbiased)
        write_motion(a.folder, name, out / "motion")
        if not (out / "reference").exists():
            (out / "reference").symlink_to(reference.resolve())
        print(name, flush=True)


if __name__ == "__main__":
    main()
