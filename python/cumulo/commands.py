"""The program's commands as functions.

Commands run in this process, on threads of their own and without Python's lock. Arguments that are not named here go to
the command as options: `max_bounces=4` is `--max-bounces=4`, True a flag, a list the option repeated, a tuple numbers
joined by commas. `help(command)` gives the text that lists them. Every function takes `progress` (True: bars and remarks;
a function: receives the events, see `cumulo.progress`) and `threads`, obeys Ctrl-C, and raises `CumuloError` where the
command refuses or a part of its work fails.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from . import _native
from .errors import CumuloError
from .options import Option, Path, extent, word, words
from .progress import Progress, listener

if TYPE_CHECKING:
    from . import results

# What every document of the program states of itself, beside its report.
ENVELOPE = ("version", "command")
# More threads are taken for a mistake.
MOST_THREADS = 1024


def call(*arguments: object, progress: Progress = False, threads: int | None = None) -> dict[str, Any]:
    """Runs a command by the words of a command line, such as `call("diff", "a.vdb", "b.vdb")`, and returns its document
    of `--json`. A check that finds a difference is no error: the document says what differs.

    Raises CumuloError, KeyboardInterrupt after Ctrl-C, and what `progress` raises.
    """
    if threads is not None and not 1 <= threads <= MOST_THREADS:
        remedy = f"give 1 to {MOST_THREADS}, or leave it out to work on all cores"
        raise CumuloError("invalid", f"{threads} threads", None, "threads", remedy)
    said, code = _native.run([word(argument) for argument in arguments], listener(progress), threads or 0)
    try:
        document: dict[str, Any] = json.loads(said)
    except ValueError:
        # Texts for people and shells: help, version, manual pages, completions.
        remedy = "run it as a program, `python -m cumulo`; of help the text is that of `cumulo.help`"
        raise CumuloError("usage", "this command has no document", None, None, remedy) from None
    if code not in (0, 1):
        raise CumuloError("frames-failed", failures(document), report=document)
    return document


def failures(document: dict[str, Any]) -> str:
    """How many parts of the work of a document failed, and what befell the first."""
    failed = document.get("failed") or [file for file in document.get("files", ()) if "error" in file]
    count = f"{len(failed)} parts" if len(failed) > 1 else "a part"
    if not failed:
        return f"{count} of the work failed; the report says which"
    error = failed[0]["error"]
    # Frames have the text of their error, files have its facts.
    if not isinstance(error, str):
        error = f"{failed[0].get('path') or failed[0].get('input')}: {error['what']}\n  {error['do']}"
    return f"{count} of the work failed{', the first' if len(failed) > 1 else ''}: {error}"


def help(command: str = "") -> str:
    """The text of `cumulo COMMAND --help`, of a command such as "reconstruct density"; without one that of all."""
    said, _ = _native.run([*command.split(), "--help"])
    return str(said)


def report(kind: str, command: Sequence[str], arguments: Sequence[Path], options: dict[str, Option],
           progress: Progress = False) -> Any:  # fmt: skip
    """Runs a command and returns its report, of the class of `results` with the name `kind`. Positional arguments stand after `--`, so that no name is an option.

    Raises TypeError for an argument that is no path, such as a list of several.
    """
    for argument in arguments:
        if not isinstance(argument, (str, os.PathLike)):
            raise TypeError(
                f"cumulo {' '.join(command)}: {argument!r} is of type {type(argument).__name__}, and the path of one file is"
                " expected (str or os.PathLike); call the function for each file, or, where it takes several, pass them"
                " one by one: f(*files)"
            )
    threads = options.pop("threads", None)
    positional = ["--", *(word(argument) for argument in arguments)]
    document = call(*command, *words(options), *positional, progress=progress, threads=threads)  # type: ignore[arg-type]
    # To make the classes takes as long as to import the rest of the package.
    from . import results

    made: type[results.Report] = getattr(results, kind)
    return made.of({key: value for key, value in document.items() if key not in ENVELOPE})


def render(scene: Path, output: Path, *, views: int | None = None, size: tuple[int, int] | str | None = None,
           density_scale: float | str | None = None, samples: int | None = None, seed: int | None = None,
           cameras: Path | None = None, progress: Progress = False, **options: Option) -> results.Rendered:  # fmt: skip
    """Renders a volume (VDB) or a scene (JSON) from many sides into a capture in the folder `output`.

    `size` is (width, height) in pixels, `density_scale` extinction per unit of density and world length or
    "auto", `samples` paths a pixel where light scatters, `cameras` a capture whose cameras are used.
    """
    named = {"output": output, "views": views, "size": extent(size), "density_scale": density_scale,
             "samples": samples, "seed": seed, "cameras": cameras}  # fmt: skip
    return report("Rendered", ["render"], [scene], {**named, **options}, progress)


def pose(capture: Path, volume: Path, output: Path, *, progress: Progress = False, **options: Option) -> results.Posed:
    """Finds where cameras stood from their pictures and the volume in them; writes the new capture's JSON."""
    return report("Posed", ["pose"], [capture], {"volume": volume, "output": output, **options}, progress)


def viewpoint(volume: Path, output: Path, *, density_scale: float | str | None = None,
              size: tuple[int, int] | str | None = None, progress: Progress = False,
              **options: Option) -> results.Viewpoints:  # fmt: skip
    """Finds the viewpoints from which a volume shows most; writes a capture's JSON."""
    named = {"output": output, "density_scale": density_scale, "size": extent(size)}
    return report("Viewpoints", ["viewpoint"], [volume], {**named, **options}, progress)


def denoise(frames: Path, output: Path, *, motion: str | None = None, progress: Progress = False,
            **options: Option) -> results.Denoised:  # fmt: skip
    """Denoises a sequence in time, or one picture. Frames are named by a pattern, `in.####.exr`; `motion` says where the
    motion is: `files:motion.####.exr`, or as `cumulo denoise --help` has it."""
    return report("Denoised", ["denoise"], [frames], {"output": output, "motion": motion, **options}, progress)


def figure(pictures: Sequence[Path], output: Path, *, title: str | None = None, label: Sequence[str] = (),
           progress: Progress = False, **options: Option) -> results.Figure:  # fmt: skip
    """Composes a figure from pictures: an SVG, a PDF or a PNG, as the name of `output` says."""
    named = {"output": output, "title": title, "label": ",".join(label) or None}
    return report("Figure", ["figure"], [*pictures], {**named, **options}, progress)


def merge(pictures: Sequence[Path], output: Path, *, progress: Progress = False,
          **options: Option) -> results.Merged:  # fmt: skip
    """Joins path-traced pictures of the same scene and view that were rendered apart."""
    return report("Merged", ["merge"], [*pictures], {"output": output, **options}, progress)


def motion(volume: Path, cameras: Path, output: Path, *, progress: Progress = False,
           **options: Option) -> results.Motion:  # fmt: skip
    """Writes the motion, in pixels, of what pictures of a volume show, as frames `out.####.exr`."""
    return report("Motion", ["motion"], [volume], {"cameras": cameras, "output": output, **options}, progress)


def compare(a: Path, b: Path, *, tolerance: float | None = None, layer: str | None = None, heatmap: Path | None = None,
            progress: Progress = False, **options: Option) -> results.Comparison:  # fmt: skip
    """Compares two EXR pictures, or two sequences; the second is the reference. They agree if no sample differs by
    more than `tolerance` (scene-linear)."""
    named = {"tolerance": tolerance, "layer": layer, "heatmap": heatmap}
    return report("Comparison", ["compare"], [a, b], {**named, **options}, progress)


def compare_statistical(a: Path, b: Path, *, repeat_a: Sequence[Path] = (), repeat_b: Sequence[Path] = (),
                        noiseless: str | None = None, tolerance: float | None = None, false_alarm: float | None = None,
                        tile: int | None = None, layer: str | None = None, heatmap: Path | None = None,
                        progress: Progress = False, **options: Option) -> results.Statistics:  # fmt: skip
    """Tests whether two noisy pictures have the same expected values, within `tolerance`.

    The noise of a side is known from further renders by other seeds (`repeat_a`, `repeat_b`), from its layers
    `variance`, or `half_a` and `half_b`; `noiseless` ("a" or "b") says that a side has none. Pictures of equal
    expected values are called different with probability `false_alarm` (default 0.001) at most. `tile` is the
    edge of a tile in pixels (default 16).
    """
    named: dict[str, Option] = {
        "statistical": True, "repeat_a": list(repeat_a), "repeat_b": list(repeat_b), "noiseless": noiseless,
        "tolerance": tolerance, "false_alarm": false_alarm, "tile": tile, "layer": layer, "heatmap": heatmap,
    }  # fmt: skip
    return report("Statistics", ["compare"], [a, b], {**named, **options}, progress)


def diff(a: Path, b: Path, *, progress: Progress = False, **options: Option) -> results.Difference:
    """Compares the grids of two VDBs."""
    return report("Difference", ["diff"], [a, b], options, progress)


def info(file: Path, *, progress: Progress = False, **options: Option) -> results.FileInfo:
    """Tells what is in one file: the grids of a VDB, the layers of an EXR, the cameras of a capture. Of several files it
    is called for each: `[cumulo.info(file) for file in files]`."""
    return report("Files", ["info"], [file], options, progress).files[0]


def view(*files: Path, output: Path, size: int | None = None, grid: str | None = None, density_scale: float | str | None = None,
         progress: Progress = False, **options: Option) -> results.Viewed:  # fmt: skip
    """Draws what is in files as contact sheets: volumes, pictures, captures and sequences.

    `output` is the PNG of the sheet, or of several files the folder of their sheets. `size` is the longer side of each
    picture in pixels, `grid` the grid of a VDB to show.
    """
    named = {"output": output, "size": size, "grid": grid, "density_scale": density_scale}
    return report("Viewed", ["view"], files, {**named, **options}, progress)


def validate(*files: Path, progress: Progress = False, **options: Option) -> results.Validation:
    """Tells what is wrong with files, and what to do about it."""
    return report("Validation", ["validate"], files, options, progress)


def convert(source: Path, output: Path, *, grid: str | list[str] | None = None, progress: Progress = False,
            **options: Option) -> results.Converted:  # fmt: skip
    """Converts VDB to VDB (with edits), VDB to .npy and back, EXR to .npy and back; see `arrays` for NumPy."""
    return report("Converted", ["convert"], [source, output], {"grid": grid, **options}, progress)


def convert_capture(source: Path, output: Path, *, progress: Progress = False, **options: Option) -> dict[str, Any]:
    """Takes over a capture of another program (COLMAP, instant-ngp, nerfstudio); returns the report as a dict."""
    found = report("Report", ["capture", "convert"], [source], {"output": output, **options}, progress)
    return found.json


def plan(scene: Path, *, views: int | None = None, size: tuple[int, int] | str | None = None,
         progress: Progress = False, **options: Option) -> results.Plan:  # fmt: skip
    """Tells which effects `render` would simulate, what they cost and how much radiance is left out at most."""
    return report("Plan", ["plan"], [scene], {"views": views, "size": extent(size), **options}, progress)


def plan_reconstruction(capture: Path, *, machines: tuple[int, ...] | None = None, progress: Progress = False,
                        **options: Option) -> results.ReconstructionPlan:  # fmt: skip
    """Tells the unknowns, the memory and the time of a reconstruction of densities, on this machine and on several."""
    return report("ReconstructionPlan", ["plan"], [capture], {"machines": machines, **options}, progress)


def gradient(scene: Path, *, wrt: str, loss: str, views: int | None = None, size: tuple[int, int] | str | None = None,
             check: bool = False, progress: Progress = False, **options: Option) -> results.Gradient:  # fmt: skip
    """Differentiates a loss on pictures of a volume with respect to `wrt` ("camera", "density", ...); `check`
    compares the derivatives with difference quotients."""
    named: dict[str, Option] = {"wrt": wrt, "loss": loss, "views": views, "size": extent(size), "check": check}
    return report("Gradient", ["gradient"], [scene], {**named, **options}, progress)
