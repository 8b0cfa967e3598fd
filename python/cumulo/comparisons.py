"""Reports of comparisons: pictures, noisy pictures, volumes."""

from __future__ import annotations

import dataclasses
import pathlib
from typing import Any

from .report import Report


@dataclasses.dataclass(frozen=True, kw_only=True)
class FrameFigures(Report):
    """Figures of a frame against the reference's; None in decibels: no error, or nothing to compare with."""

    frame: int
    psnr_db: float | None
    ssim: float
    rel_mse: float
    max_abs: float
    flip: float | None = None
    flicker_psnr_db: float | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Comparison(Report):
    """Two pictures, or two sequences (`frames` is not empty then). Truth value: they agree.

    `psnr_db` is None for identical colors.
    """

    psnr_db: float | None
    ssim: float
    rel_mse: float
    max_abs: float
    rms: float | None = None
    alpha_max_abs: float | None = None
    peak: float
    size: tuple[int, ...] | None = None
    non_finite_pixels: int | None = None
    non_finite_differences: int | None = None
    layers: tuple[str, ...] | None = None
    differ: bool
    differences: list[str] = dataclasses.field(default_factory=list)
    converted: str | None = None
    flip: float | None = None
    heatmap_scale: float | None = None
    frames: list[FrameFigures] = dataclasses.field(default_factory=list)
    flicker_psnr_db: float | None = None
    beside: dict[str, Any] | None = None
    left_out: list[int] = dataclasses.field(default_factory=list)
    failed: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    report: pathlib.Path | None = None

    def __bool__(self) -> bool:
        return not self.differ


@dataclasses.dataclass(frozen=True, kw_only=True)
class MeanTest(Report):
    """Mean of A minus mean of B over the picture, with a 95 % interval; `t` beyond the tolerance."""

    difference: float
    interval: tuple[float, ...] | None
    t: float | None
    freedom: float | None
    p: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class Region(Report):
    """A pixel or tile: its place in pixels, its mean difference and the standard error of that."""

    x: int
    y: int
    width: int
    height: int
    difference: float
    standard_error: float
    t: float | None
    freedom: float | None


@dataclasses.dataclass(frozen=True, kw_only=True)
class RegionTests(Report):
    """Tests of all pixels or tiles: `p` is corrected for their number (Šidák)."""

    count: int
    p: float
    worst: Region | None


@dataclasses.dataclass(frozen=True, kw_only=True)
class SpreadTest(Report):
    """Mean square of the differences against the mean variance."""

    mean_square: float
    mean_variance: float
    z: float
    p: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class ChannelTests(Report):
    """The four tests of a channel."""

    channel: str
    mean: MeanTest
    pixels: RegionTests
    tiles: RegionTests
    spread: SpreadTest


@dataclasses.dataclass(frozen=True, kw_only=True)
class Noise(Report):
    """Where the variances of a side come from: "none", "repeats", "variance" or "halves"."""

    source: str
    pictures: int
    freedom: float | None
    remark: str | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Statistics(Report):
    """Tests whether two noisy pictures have the same expected values. Truth value: no difference was found.

    `p` is corrected for all tests; below `false_alarm` the pictures differ.
    """

    size: tuple[int, ...]
    differ: bool
    p: float
    false_alarm: float
    tolerance: float
    left_out: int
    non_finite_differences: int
    channels: list[ChannelTests]
    noise: dict[str, Any]
    heatmap_scale: float | None = None

    def __bool__(self) -> bool:
        return not self.differ

    @property
    def sides(self) -> tuple[Noise, Noise]:
        """Noise of the two sides."""
        return Noise.of(self.noise["a"]), Noise.of(self.noise["b"])


@dataclasses.dataclass(frozen=True, kw_only=True)
class GridDifference(Report):
    """Differences of two grids of one name; PSNR is None for equal values.

    `sampled`: figures are of `compared` voxels, evenly spread; `agrees_after_turn`: up axes differ; `multiple`: the `factor` of
    the first that the second is nearest to, and the `psnr_db` after a division by it.
    """

    name: str
    psnr_db: float | None
    rms: float | None
    max_abs: float | None
    topology_iou: float | None
    transform_difference: float | None
    voxels: int | None
    incomparable: int | None = None
    differs_beyond_f32: bool | None = None
    compared: int | None = None
    sampled: bool | None = None
    agrees_after_turn: dict[str, Any] | None = None
    multiple: dict[str, float | None] | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Difference(Report):
    """Two VDBs. Truth value: they are the same."""

    same: bool
    grids: list[GridDifference]
    only_in_a: list[str]
    only_in_b: list[str]
    not_compared: list[Any]
    of_other_kind: list[str] = dataclasses.field(default_factory=list)
    up: dict[str, Any] | None = None
    creator: dict[str, Any] | None = None
    differences: list[str] = dataclasses.field(default_factory=list)

    def __bool__(self) -> bool:
        return self.same
