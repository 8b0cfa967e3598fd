"""Whether two estimates of a picture agree, by their independent batches.

Each pixel and channel, and each block of pixels, is compared by Welch's t test: the difference of the means of the
batches over its standard error. The t distribution of as many degrees of freedom as both variances together have turns it
into the number of standard deviations of a normal distribution that is as unlikely, |z|. A batch is a mean over dozens of
paths and 16 batches make a mean, so that means are close to normal where enough paths meet the medium; pixels where they
are few, along the border of a volume, take part in their blocks only: the mean of rare events is skewed, and batches that
missed them all would tell no variance.

All comparisons with Mitsuba share one chance ALPHA of a false alarm: by Šidák's correction each has the chance
1 - (1 - ALPHA)^(1/n), which the threshold of |z| follows from. It needs no independence on the safe side of it: channels
of a pixel and blocks of pixels go together, which makes false alarms rarer.
"""

import dataclasses

import numpy as np
from scipy import stats

ALPHA = 1e-3
BLOCK = 8
# Paths of all batches that are expected to meet the medium in a pixel that is compared by itself.
MEETINGS = 128
# Pictures are stored in f32, and sums of f32 are rounded at every step.
ROUNDING = 2.0**-18


@dataclasses.dataclass(frozen=True)
class Verdict:
    """Largest |z| over pixels and over blocks, and the mean radiance of either side."""

    pixel: float
    block: float
    ours: float
    theirs: float

    @property
    def worst(self):
        """The larger of both."""
        return max(self.pixel, self.block)


def threshold(comparisons):
    """The |z| that `comparisons` of them exceed with the chance ALPHA if nothing differs."""
    return float(stats.norm.isf(-0.5 * np.expm1(np.log1p(-ALPHA) / comparisons)))


def comparisons(size):
    """How many a picture of size x size pixels takes: pixels, blocks and the picture as a whole, by channel."""
    return 3 * (size**2 + (size // BLOCK) ** 2 + 1)


def error_of(batches):
    """Squared standard error of the mean, and its degrees of freedom; 0 of a single picture, which is exact."""
    free = len(batches) - 1
    return (batches.var(axis=0, ddof=1) / (free + 1), free) if free else (np.zeros(batches.shape[1:]), 1)


def deviations(ours, theirs):
    """|z| of batches [batch, ...], elementwise."""
    (first, first_free), (second, second_free) = error_of(ours), error_of(theirs)
    mean = theirs.mean(axis=0)
    variance = first + second
    # Where nothing is random there is only rounding, which the smallest variance stands for.
    free = np.where(variance > 0.0, variance**2 / np.maximum(first**2 / first_free + second**2 / second_free, 1e-300), 1.0)
    t = np.abs(ours.mean(axis=0) - mean) / np.sqrt(variance + (ROUNDING * np.abs(mean)) ** 2 + 1e-30)
    return stats.norm.isf(np.maximum(stats.t.sf(t, np.maximum(free, 1.0)), 1e-300))


def block_means(pictures):
    """Means over the blocks of pictures [batch, height, width, channel], [batch, block, channel], and over each as a whole."""
    batch, height, width, channels = pictures.shape
    blocks = pictures.reshape(batch, height // BLOCK, BLOCK, width // BLOCK, BLOCK, channels).mean(axis=(2, 4))
    whole = pictures.mean(axis=(1, 2))[:, None]
    return np.concatenate([blocks.reshape(batch, -1, channels), whole], axis=1)


def judge(ours, theirs, paths):
    """Compares our batches of red, green, blue and alpha with theirs of red, green and blue, or with an exact picture as a
    single batch; `paths` is the number of paths of a pixel and batch on the side that has fewer."""
    opacity = ours[..., 3:].mean(axis=0)
    ours = ours[..., :3]
    often = paths * len(ours) * opacity >= MEETINGS
    pixels = np.where(often, deviations(ours, theirs), 0.0)
    blocks = deviations(block_means(ours), block_means(theirs))
    assert np.mean(often) > 0.3, "the volume is in the picture"
    return Verdict(float(pixels.max()), float(blocks.max()), float(ours.mean()), float(theirs.mean()))
