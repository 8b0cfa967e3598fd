"""Transfer functions: the program's command, and `.tf.json` files of Blender's color ramps.

    from cumulo import transfer
    print([function.name for function in transfer.presets()])
    transfer.convert("viridis", "thin.tf.json", range=(0, 0.5), extinction=8)
    transfer.suggest("head.nii.gz", "head.tf.json", sheet="sheet.png")

    from cumulo.transfer import transfer_from_color_ramp, write_transfer
    ramp = material.node_tree.nodes["Color Ramp"].color_ramp
    write_transfer("smoke.tf.json", transfer_from_color_ramp(ramp, domain=(0, 2), extinction=10))
"""

from __future__ import annotations

import json
import math
import os
import pathlib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from .commands import report
from .options import Option, Path
from .progress import Progress

if TYPE_CHECKING:
    from .results import Preset, Presets, Suggestion, Transfer

# Position and color of a knot.
Knot = tuple[float, tuple[float, ...]]

# Curves are sampled at this many equal steps, and beside where the ramp itself has a kink or a step.
STEPS = 256


def convert(source: Path, output: Path | None = None, *, preset: str | None = None, range: tuple[float, float] | None = None,
            extinction: float | None = None, unit_distance: float | None = None, progress: Progress = False,
            **options: Option) -> Transfer:  # fmt: skip
    """Tells what a transfer function holds, and writes it as `.tf.json` where `output` is given.

    `source` is a name (`presets`), a `.tf.json`, a color map preset of ParaView or a VDB that carries one; `preset` says
    which of several. `range` is the densities that its own range is mapped to, `extinction` that at the end of a color
    map per world unit, `unit_distance` the world length that the opacities of a preset are for.
    """
    named: dict[str, Option] = {"output": output, "preset": preset, "range": range, "extinction": extinction,
                                "unit_distance": unit_distance}  # fmt: skip
    return report("Transfer", ["transfer"], [source], {**named, **options}, progress)


def suggest(volume: Path, output: Path | None = None, *, candidate: int | None = None, sheet: Path | None = None,
            grid: str | None = None, progress: Progress = False, **options: Option) -> Suggestion:  # fmt: skip
    """Finds the boundaries between the materials of a VDB, NanoVDB or scan, and functions that show them.

    The function `candidate`, a number from 1 (None: all boundaries together), is written as `.tf.json` where `output` is
    given, and a picture through each to the PNG `sheet`. `grid` is the one of a VDB with several.
    """
    named: dict[str, Option] = {"suggest": volume, "output": output, "candidate": candidate, "sheet": sheet, "grid": grid}
    return report("Suggestion", ["transfer"], [], {**named, **options}, progress)


def presets() -> list[Preset]:
    """Lists the transfer functions that are there by name, as `tf=` of `cumulo.render` takes them."""
    return report("Presets", ["transfer"], [], {"list": True}).functions


def transfer_from_color_ramp(ramp: Any, domain: Sequence[float] = (0.0, 1.0), extinction: float = 1.0,
                             name: str | None = None) -> dict[str, Any]:  # fmt: skip
    """What a `bpy.types.ColorRamp` says of densities, as the dict that a `.tf.json` holds.

    Positions 0 and 1 stand for the two densities of `domain`. Colors are the ramp's, scene-linear in
    Blender already; extinction is its alpha times `extinction`, per world unit. Raises ValueError where
    those are no ascending densities, or no finite extinction from zero on.
    """
    low, high = map(float, domain)
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise ValueError(f"domain {domain}: two ascending densities are expected")
    if not (math.isfinite(extinction) and extinction >= 0):
        raise ValueError(f"extinction {extinction}: a finite number from zero on is expected")
    points = [
        # Both ends of the domain exactly. Cardinal curves swing below zero.
        [(1.0 - at) * low + at * high, *(max(c, 0.0) for c in color[:3]), max(color[3], 0.0) * extinction]
        for at, color in _knots(ramp)
    ]
    document: dict[str, Any] = {"format": "cumulo-transfer-function", "version": 1}
    if name is not None:
        document["name"] = name
    return document | {"transfer": {"kind": "piecewise", "points": points}}


def write_transfer(path: Path, document: Mapping[str, Any]) -> None:
    """Writes a `.tf.json`, whole or not at all."""
    import tempfile

    path = pathlib.Path(path)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".writing-") as folder:
        draft = pathlib.Path(folder) / path.name
        draft.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n")
        os.replace(draft, path)


def _knots(ramp: Any) -> list[Knot]:
    """(position, color) between which the ramp is linear; two of one position are a step."""
    elements = [(element.position, tuple(element.color)) for element in ramp.elements]
    if ramp.interpolation == "CONSTANT":
        # Each color holds up to the next element; before the first it is the first's.
        before = [elements[0], *elements[:-1]]
        knots = [pair for (_, old), (at, new) in zip(before, elements) for pair in ((at, old), (at, new))]
    elif ramp.interpolation == "LINEAR" and ramp.color_mode == "RGB":
        knots = elements
    else:
        import numpy as np

        # Elements are evaluated from either side: they are where curves have kinks, and, two in one
        # place, steps.
        exact = {np.float32(at) for at, _ in elements}
        steps = {np.float32(i / STEPS) for i in range(STEPS + 1)} - exact
        beside = [(at, np.nextafter(at, np.float32(side))) for at in exact for side in (-1, 2)]
        # Sorted by place, then from lower to upper side.
        places = sorted([(at, at) for at in steps] + beside)
        knots = [(float(at), tuple(ramp.evaluate(float(side)))) for at, side in places]
    return _merged(knots)


def _merged(knots: Sequence[Knot]) -> list[Knot]:
    """Of the knots of one place the first and the last; once, if they agree."""
    kept: list[Knot] = []
    for at, color in knots:
        if len(kept) > 1 and kept[-2][0] == at:
            kept.pop()
        if not kept or kept[-1] != (at, color):
            kept.append((at, color))
    return kept
