"""How noisy Cycles' pictures are: the floor that no comparison with one of them can go below."""

import dataclasses
import math

import numpy as np

from cumulo import blender


@dataclasses.dataclass(frozen=True)
class Floor:
    """Noise of one picture, root mean square over pixels and colors, and its PSNR (peak 1) in dB:
    `psnr_db` against the truth, `between_seeds_db` of two such pictures against each other."""

    rms: float
    psnr_db: float
    between_seeds_db: float


def floor_of(first, second):
    """Floor from two pictures [height, width, 3 or 4] of one view that differ in their seeds only."""
    difference = np.asarray(first, np.float64)[..., :3] - np.asarray(second, np.float64)[..., :3]
    between = math.sqrt(np.mean(difference**2))
    # The two errors are independent, so that their difference has twice the variance of one.
    rms = between / math.sqrt(2.0)
    return Floor(rms, decibels(rms), decibels(between))


def decibels(rms):
    """PSNR with peak 1; infinite without an error."""
    return -20.0 * math.log10(rms) if rms > 0 else math.inf


def noise_floor(vdb, camera, settings, grid="density"):
    """Renders one view of a VDB by two seeds (settings.seed and its neighbour) and compares them."""
    stage = blender.Stage(settings, vdb, grid)
    return floor_of(*(stage.picture(camera, settings.seed + i) for i in (0, 1)))
