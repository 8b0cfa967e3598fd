"""Reconstruction from multi-view pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .commands import report
from .options import Option, Path
from .progress import Progress

if TYPE_CHECKING:
    from .results import Reconstruction, TransferFunction


def density(capture: Path, output: Path, *, resolution: int | None = None, voxel_size: float | None = None,
            iterations: int | None = None, progress: Progress = False, **options: Option) -> Reconstruction:  # fmt: skip
    """Reconstructs densities as a VDB. `resolution` is the number of voxels along the longest edge, `voxel_size`
    the edge of a voxel in world units; give one of the two, or none for the capture's lattice."""
    named = {"output": output, "resolution": resolution, "voxel_size": voxel_size, "iterations": iterations}
    return report("Reconstruction", ["reconstruct", "density"], [capture], {**named, **options}, progress)


def color(capture: Path, output: Path, *, resolution: int | None = None, voxel_size: float | None = None,
          iterations: int | None = None, progress: Progress = False, **options: Option) -> Reconstruction:  # fmt: skip
    """Reconstructs a pre-shaded volume, extinctions and emissions in red, green and blue, as a VDB."""
    named = {"output": output, "resolution": resolution, "voxel_size": voxel_size, "iterations": iterations}
    return report("Reconstruction", ["reconstruct", "color"], [capture], {**named, **options}, progress)


def tf(capture: Path, volume: Path, output: Path, *, texels: int | None = None, progress: Progress = False,
       **options: Option) -> TransferFunction:  # fmt: skip
    """Reconstructs the transfer function (.tf.json) through which the pictures show a known volume."""
    named = {"volume": volume, "output": output, "texels": texels}
    return report("TransferFunction", ["reconstruct", "tf"], [capture], {**named, **options}, progress)
