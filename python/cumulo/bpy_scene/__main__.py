"""Blender files to and from Cumulo, on the command line (needs `bpy` 5.0.1).

python -m cumulo.bpy_scene export smoke.blend --animation -o scene
python -m cumulo.bpy_scene capture smoke.blend --views 24 -o shots
python -m cumulo.bpy_scene load found.vdb --into smoke.blend --like Smoke -o both.blend
"""

import argparse
import pathlib
import sys

import bpy

from . import Refused, capture, export, frames_of, load
from ..cycles.stage import quiet
from ..cycles.views import capture_line


def _frames(text):
    first, _, last = text.partition("-")
    return range(int(first), int(last or first) + 1)


def _size(text):
    width, height = text.lower().split("x")
    return int(width), int(height)


def parser():
    """The parser of the command line."""
    top = argparse.ArgumentParser(prog="python -m cumulo.bpy_scene", description="Blender files to and from Cumulo")
    commands = top.add_subparsers(dest="command", required=True)
    one = commands.add_parser("export", help="write scene files and cameras for `cumulo render`")
    one.add_argument("blend")
    frames = one.add_mutually_exclusive_group()
    frames.add_argument("--frames", type=_frames, metavar="A-B", help="frames (default: the present one)")
    frames.add_argument("--animation", action="store_true", help="all frames of the scene")
    one.add_argument("--ignore", action="store_true", help="leave out what Cumulo does not have, such as meshes, and say so")
    two = commands.add_parser("capture", help="render views of a volume for `cumulo reconstruct`")
    two.add_argument("blend")
    two.add_argument("--volume", metavar="NAME", help="object (default: the only volume)")
    two.add_argument("--views", type=int, default=24, metavar="N", help="cameras around the volume (24)")
    two.add_argument("--size", type=_size, default=(128, 128), metavar="WxH", help="of the views (128x128)")
    two.add_argument("--samples", type=int, default=32, metavar="N", help="per pixel (32)")
    three = commands.add_parser("load", help="put a VDB into a Blender file, with a material")
    three.add_argument("vdb")
    three.add_argument("--into", required=True, metavar="BLEND")
    medium = three.add_mutually_exclusive_group()
    medium.add_argument("--like", metavar="NAME", help="object whose medium it gets")
    medium.add_argument("--capture", metavar="CAPTURE", help="capture whose density scale it gets")
    for each, what in ((one, "DIR"), (two, "DIR"), (three, "BLEND")):
        each.add_argument("-o", "--output", required=True, metavar=what)
    return top


def _open(path):
    """Opens a Blender file. Raises OSError where it cannot be read."""
    if not pathlib.Path(path).is_file():
        raise FileNotFoundError(f"{path}: no such file; name a .blend")
    try:
        with quiet():
            bpy.ops.wm.open_mainfile(filepath=str(pathlib.Path(path).resolve()))
    except RuntimeError as error:
        raise OSError(f"{path}: Blender cannot open it: {error}") from error


def _refuse_input(output, *inputs):
    """Raises ValueError where the output is one of the inputs, by whatever name."""
    path = pathlib.Path(output)
    for given in map(pathlib.Path, inputs):
        # Links lead to one file as well.
        same = path.samefile(given) if path.exists() and given.exists() else path.resolve() == given.resolve()
        if same:
            raise ValueError(f"{output}: it is the input {given}, and inputs are not overwritten; give another name by -o")


def main(arguments=None):
    """The command line; see the top of this file."""
    options = parser().parse_args(arguments)
    if options.command == "load":
        _refuse_input(options.output, options.into, options.vdb)
    _open(options.into if options.command == "load" else options.blend)
    if options.command == "export":
        frames = frames_of(bpy.context.scene) if options.animation else options.frames
        written = export(options.output, frames=frames, ignore=options.ignore)
        for each in written.left_out:
            print(f"left out: {each}", file=sys.stderr)
        print(written.command(pathlib.Path(options.output) / "render"))
    elif options.command == "capture":
        made = capture(options.output, volume=options.volume, views=options.views, size=options.size, samples=options.samples)
        print(capture_line(options.output, made))
    else:
        thing = load(options.vdb, like=options.like, capture=options.capture)
        with quiet():
            bpy.ops.wm.save_as_mainfile(filepath=str(pathlib.Path(options.output).resolve()))
        medium = f"the medium of {options.like!r}" if options.like else "a medium that absorbs"
        print(f"{options.output}: the object {thing.name!r} shows {options.vdb}, with {medium}")


if __name__ == "__main__":
    try:
        main()
    except Refused as error:
        print("\n".join(f"error: {complaint}" for complaint in error.complaints), file=sys.stderr)
        optional = sum(bool(complaint.without) for complaint in error.complaints)
        if optional and "--ignore" not in sys.argv:
            print(f"hint: export --ignore leaves out {optional} of these {len(error.complaints)}", file=sys.stderr)
        sys.exit(2)
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
