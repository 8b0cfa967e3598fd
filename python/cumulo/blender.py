"""Renders volumes with Blender's Cycles, as a reference (needs `bpy` 5.0.1).

    python -m cumulo.blender render smoke.vdb --capture DIR/transforms.json -o OUT
    python -m cumulo.blender render smoke.vdb --views 32 --size 128x128 -o OUT
    python -m cumulo.blender load reconstructed.vdb

`render` writes one single-part 32-bit float EXR a view, and `transforms.json`. All that would make a
picture prettier than the integral it stands for is off: denoising, adaptive sampling, clamping,
clipping, view transforms.
"""

import argparse
import json
import math
import pathlib
import sys

import bpy
import numpy as np
from mathutils import Vector

# First, for it exposes the modules that Blender brings.
from .cycles import Rectangle, Settings, Sphere, Stage, Sun  # isort: skip
from . import padding
from .capture import Capture, sphere_cameras
from .cycles.objects import load_volume
from .cycles.stage import empty_scene
from .cycles.views import capture_line, capture_steps, finish

# Angle across a sun, in degrees, which `cumulo render` takes as well.
SUN_ANGLE = 0.53

__all__ = ["Rectangle", "Settings", "Sphere", "Stage", "Sun", "main", "render_capture", "show_progress", "where"]


def render_capture(vdb, cameras, settings, folder, grid="density", progress=None):
    """Renders one view a camera into `folder` and writes its `transforms.json`; returns the Capture.

    Each view has a seed of its own (settings.seed + its number), so that noise does not repeat.
    """
    matrix, _ = padding.lattice(vdb, grid)
    return finish(capture_steps(Stage(settings, vdb, grid), cameras, folder, matrix), progress)


def where(path):
    """Loads a VDB into an empty scene and says where Blender puts it: per grid its type, and the
    object's world box; as JSON-ready data."""
    volume = load_volume(empty_scene(), path)
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
        given["anisotropy"] = options.anisotropy or 0.0
        # As of `cumulo render`: without any light the sky is white.
        given["sky"] = tuple(options.sky) if options.sky else ((0.0, 0.0, 0.0) if options.sun else (1.0, 1.0, 1.0))
        given["lights"] = _sun(options)
        if capture:
            given.setdefault("density_scale", capture.density_scale)
            given.setdefault("near", capture.near)
        return Settings(**given)
    if capture:
        for key in ("model", "density_scale", "background", "emission", "near"):
            given.setdefault(key, getattr(capture, key))
        _check_model(capture, given["model"])
    return Settings(**given)


def _sun(options):
    """The sun of the command line, if it has one, in the terms and with the defaults of `cumulo render`."""
    if options.sun is None:
        for flag in ("sun_color", "sun_angle"):
            if getattr(options, flag) is not None:
                name = "--" + flag.replace("_", "-")
                raise ValueError(f"{name} is given without a sun; give --sun X Y Z, the vector towards it, or leave {name} out")
        return ()
    if not any(options.sun):
        raise ValueError("--sun is 0 0 0, which is no direction; give the vector from the volume towards the sun, as in --sun -1 0.6 0.7")
    angle = SUN_ANGLE if options.sun_angle is None else options.sun_angle
    return (Sun(tuple(options.sun), tuple(options.sun_color or (1.0, 1.0, 1.0)), math.radians(angle)),)


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
    render.add_argument("--sun-color", type=float, nargs=3, metavar=("R", "G", "B"), help="irradiance of the sun (1 1 1)")
    render.add_argument("--sun-angle", type=float, metavar="DEG", help=f"angle across the sun in degrees ({SUN_ANGLE})")
    render.add_argument(
        "--sky", type=float, nargs=3, metavar=("R", "G", "B"), help="radiance from all around (black with a sun, else white)"
    )
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
    made = render_capture(
        options.vdb,
        views,
        _settings(options, capture),
        options.output,
        options.grid,
        show_progress,
    )
    print(capture_line(options.output, made))


if __name__ == "__main__":
    try:
        main()
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
