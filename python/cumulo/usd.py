"""USD stages of volumes: writing them, and saying what is wrong with them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .commands import report
from .options import Option, Path
from .progress import Progress

if TYPE_CHECKING:
    from .results import Authored, Linted


def author(source: Path, output: Path, *, renderer: str | None = None, density_scale: float | None = None,
           camera: Path | None = None, progress: Progress = False, **options: Option) -> Authored:  # fmt: skip
    """Writes a stage (`.usda`) of a VDB, a sequence such as `smoke.####.vdb`, or a scene file.

    `renderer` selects the material ("arnold", "cycles", "materialx"; by default the stage has none selected),
    `density_scale` is extinction per unit of density and world length, `camera` a capture whose cameras are written.
    """
    named: dict[str, Option] = {"output": output, "renderer": renderer, "density_scale": density_scale, "camera": camera}
    return report("Authored", ["usd", "author"], [source], {**named, **options}, progress)


def lint(*stages: Path, fix: Path | None = None, progress: Progress = False, **options: Option) -> Linted:
    """Tells what is wrong with stages, and what to do about it. `fix` is a layer (`.usda`) to be written over the only
    stage, which removes the faults that have one remedy. Raises CumuloError where a stage cannot be read."""
    return report("Linted", ["usd", "lint"], stages, {"fix": fix, **options}, progress)
