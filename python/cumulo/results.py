"""Reports of the program as dataclasses.

Fields have the names of the JSON's keys. Keys that a class does not know (of a newer program, or of one kind of files
alone) are kept in `extra`, and `json` is the report as it came. Paths are `pathlib.Path`; lengths are in world units,
positions and matrices in world space, matrices row by row and acting on columns, times in seconds. A figure that is not
finite is None.

Written by python/report_classes.py from the program's schemas, not by hand.
"""

from __future__ import annotations

import dataclasses
import pathlib
from typing import Any

from .report import Report

__all__ = [
    "Accuracy",
    "ArrayGrid",
    "ArrayLayer",
    "Authored",
    "AuthoredVolume",
    "Caution",
    "ChannelTests",
    "Comparison",
    "Converted",
    "Denoised",
    "Derivative",
    "Difference",
    "Effect",
    "Failed",
    "Figure",
    "FigurePanel",
    "FileFindings",
    "FileInfo",
    "Files",
    "FrameFigures",
    "Gradient",
    "GridDifference",
    "Iteration",
    "LintFinding",
    "Linted",
    "LintedStage",
    "MachineTime",
    "Material",
    "MeanTest",
    "Merged",
    "Motion",
    "Noise",
    "Plan",
    "PlannedMemory",
    "PlannedScaling",
    "PlannedStage",
    "Posed",
    "PosedCamera",
    "Preset",
    "Presets",
    "Provenance",
    "Reconstruction",
    "ReconstructionPlan",
    "Region",
    "RegionTests",
    "Rendered",
    "Renewed",
    "Report",
    "Sheet",
    "SpreadTest",
    "Stage",
    "Start",
    "Statistics",
    "SuggestedBoundary",
    "SuggestedFunction",
    "Suggestion",
    "Transfer",
    "TransferFunction",
    "Up",
    "Validation",
    "Viewed",
    "Viewpoints",
]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Caution(Report):
    """A remark on a result that the user should know of."""

    do: str
    """Remedy: the setting that would fit."""
    what: str
    """Contradiction: the value found, and the value expected."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Failed(Report):
    """A frame without a result."""

    code: str
    """Code of the error, for programs."""
    error: str
    """The error with its remedy."""
    frame: int
    """Number of the frame."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Renewed(Report):
    """Frames that one changed input had made again."""

    frames: list[int]
    """Numbers of the frames."""
    input: pathlib.Path
    """Path of the input."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Stage(Report):
    """A stage of the work and the wall time it took."""

    name: str
    """Name of the stage."""
    seconds: float | None
    """Wall time in seconds."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Provenance(Report):
    """Provenance of an output: program, origin, settings, inputs and wall time."""

    command: str
    """Command line, its words quoted for a shell; of work for another face, what that calls itself."""
    inputs: dict[str, str]
    """SHA-256 of the bytes of each input in hexadecimal digits, by the input's path."""
    resumable: str | None = None
    """SHA-256 of the settings that `resume` compares, in hexadecimal digits: all but those of where the work begins,
    how far it goes and where it writes; empty for work that does not go on from its output."""
    seconds: float | None
    """Seconds from the start of the work to the writing of the output."""
    settings: str | None = None
    """SHA-256 of the settings that results depend on, in hexadecimal digits; empty where none are stated."""
    software: str
    """Name and version of the program."""
    use_case: str | None = None
    """Name of the use case, such as `render`; empty where none is stated."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Up(Report):
    """Up axis with the reason for it."""

    axis: str
    """Axis that points upwards."""
    reason: str
    """Reason for the axis, in words."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Rendered(Report):
    """Report of views."""

    accuracy: dict[str, Any] | None = None
    """Errors of the pictures, if a target or a time was asked for."""
    deep: dict[str, Any] | None = None
    """Samples of deep pictures."""
    density_scale: float | None
    """Extinction per unit of density and length; none for a scene whose volumes have different ones."""
    density_scales: list[float] = dataclasses.field(default_factory=list)
    """Density scales of the volumes of a scene file or a stage, in their order."""
    early_stop: dict[str, Any] | None = None
    model: str
    output: pathlib.Path
    paths: dict[str, Any] | None = None
    plan: dict[str, Any] | None
    """Plan of a scene that may scatter, or out of which something may be left."""
    quadrature: str | None = None
    quadrature_error_bound: float | None = None
    """Bound of the error that the quadrature makes in any channel of a pixel, in the channel's units; null where no
    bound is known."""
    relative_error_bound: float | None = None
    """Bound of both errors by the scale of the picture, the largest of all pictures, if an error was asked for."""
    remarks: list[str] = dataclasses.field(default_factory=list)
    """Remarks on statements of a USD stage that have no effect, and on what is assumed."""
    seconds: float | None
    skipped: int
    """Number of views that were there, made by the same settings."""
    tone_mapping: dict[str, Any] | None = None
    """How radiance became the samples of PNGs; none if none were written."""
    up: Up | None
    """Up axis about which cameras were placed; none where they were given."""
    views: int
    """Number of views that were rendered."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Iteration(Report):
    """One iteration, for the progress display and the convergence plot."""

    held_out_psnr_db: float | None
    """PSNR of the held-out views' transmittance (peak 1), if there are any."""
    iteration: int
    """Iteration, all levels counted."""
    level: int | None = None
    """Level, 0 the finest."""
    loss: float | None = None
    """Objective: the weighted RMS of the optical depths' residuals; for the recipe of Weiss & Westermann (2021), the
    mean absolute difference of the batch's pictures."""
    rms: float | None = None
    """Root mean square difference over the rays that were used."""
    seconds: float | None
    """Seconds since the start."""
    smooth: float | None = None
    """Weight of the prior."""

    @property
    def objective(self) -> float | None:
        """The loss, or the RMS."""
        return self.rms if self.loss is None else self.loss


@dataclasses.dataclass(frozen=True, kw_only=True)
class Reconstruction(Report):
    """Record of a reconstruction of voxels."""

    cameras: dict[str, Any] | None
    """Cameras that were refined, if `refine_cameras` asks for it."""
    capture: pathlib.Path
    """Path of the pictures' transforms.json."""
    expected: dict[str, Any] | None
    """Cost that was expected before the work."""
    grid: str
    """Name of the written grid of densities or extinctions."""
    held_out: list[int]
    """Numbers of the held-out views."""
    held_out_psnr_db: float | None
    """PSNR of the held-out views in dB, peak 1; none without such views."""
    history: list[Iteration]
    """Every iteration."""
    iterations: int
    """Number of iterations over all levels."""
    layer: str | None
    """Layer of the pictures, if `layer` names one."""
    output: pathlib.Path
    """Path of the VDB that was written."""
    peak_memory_mb: float | None
    """Largest resident memory of the process in MB (2²⁰ bytes); none where the system does not tell."""
    provenance: Provenance
    """Version, command line and hashes of the inputs."""
    report: pathlib.Path | None
    """Path of the page, if `report` requests one."""
    seconds: float | None
    """Wall time in seconds up to the writing of the VDB."""
    shown: list[int]
    """Numbers of the views that the page shows."""
    solver: str
    """Solver of the voxels."""
    stages: list[Stage]
    """Wall time of each stage."""
    stopped: bool
    """True if the user stopped the work."""
    train_psnr_db: float | None
    """PSNR of the training views in dB, peak 1; none if the work was stopped before it was measured."""
    unknowns: int
    """Unknown voxels on the finest level."""
    views: int
    """Number of views."""
    voxel_size: tuple[float, ...]
    """Edge lengths of the voxels in world units."""
    warnings: list[Caution]
    """Contradictions between pictures and model, found before and after the work."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TransferFunction(Report):
    """Record of a reconstruction of a transfer function."""

    capture: pathlib.Path
    """Path of the pictures' transforms.json."""
    confidence: list[tuple[float, ...]]
    """Confidence of each texel's extinction and color, 0 to 1: the share of the pictures beside that of the prior;
    empty after a descent."""
    domain: tuple[float, ...]
    """Range of densities that the texels cover."""
    expected: dict[str, Any] | None
    """Cost that was expected before the work."""
    grid: str | None
    """Grid of the volume, if `grid` names one."""
    held_out: list[int]
    """Numbers of the held-out views."""
    held_out_psnr_db: float | None
    """PSNR of the held-out views in dB, peak 1; none without such views."""
    held_out_ssim: float | None
    """Structural similarity of the held-out views, mean over views; none without such views."""
    history: list[Iteration]
    """Every refinement or epoch."""
    iterations: int
    """Number of refinements, or of epochs."""
    layer: str | None
    """Layer of the pictures, if `layer` names one."""
    output: pathlib.Path
    """Path of the transfer function that was written."""
    peak_memory_mb: float | None
    """Largest resident memory of the process in MB (2²⁰ bytes); none where the system does not tell."""
    provenance: Provenance
    """Version, command line and hashes of the inputs."""
    quadrature: str
    """Quadrature of the rays."""
    report: pathlib.Path | None
    """Path of the page, if `report` requests one."""
    seconds: float | None
    """Wall time in seconds up to the writing of the function."""
    shown: list[int]
    """Numbers of the views that the page shows."""
    smooth: float | None
    """Weight of the smoothness prior."""
    solver: str
    """Solver of the texels."""
    stages: list[Stage]
    """Wall time of each stage."""
    stopped: bool
    """True if the user stopped the work."""
    texels: int
    """Number of texels."""
    train_rms: float | None
    """Root mean square difference over the rays of the training views, after the last step."""
    views: int
    """Number of views."""
    volume: pathlib.Path
    """Path of the volume in the pictures."""
    warnings: list[Caution]
    """Contradictions between pictures and model, found before and after the work."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PosedCamera(Report):
    """A camera before and after the search."""

    iterations: int
    moved_percent: float | None
    """Distance between the positions before and after, in percent of the distance to the volume's centre."""
    note: str | None
    picture: str
    rms_after: float | None
    """RMS difference of the colors between picture and render, with the camera that the search ended with."""
    rms_before: float | None
    """RMS difference of the colors between picture and render, with the camera that the search began with."""
    rotated_degrees: float | None
    """Angle in degrees between the camera's axes before and after."""
    undetermined: int
    """Number of the camera's six directions of motion that the picture does not determine: along them it stays."""
    unexplained_variance: float | None
    """Share of the picture's variance that the search left unexplained, white noise apart; none if it was stopped."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Posed(Report):
    """Report of a search for cameras."""

    cameras: list[PosedCamera]
    focal_factor: float | None
    """Focal length divided by that of the capture; none without `solve_focal`."""
    iterations: int
    output: pathlib.Path
    report: pathlib.Path | None
    rms_after: float | None
    """RMS difference of the colors over all cameras after the search."""
    rms_before: float | None
    """RMS difference of the colors over all cameras before the search."""
    seconds: float | None
    stopped: bool
    """True if the search was stopped before its end."""
    warnings: list[Caution]
    """Contradictions between the pictures and the model."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Start(Report):
    """A local search, from its start to its end."""

    end: tuple[float, ...]
    """Unit vector from the sphere's centre to the camera at the end."""
    entropy: float | None
    """Opacity entropy of the picture at the end."""
    iterations: int
    """Number of evaluations."""
    start: tuple[float, ...]
    """Unit vector from the sphere's centre to the camera at the start."""
    view: int
    """Number of the view that the search from this start has reached."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Viewpoints(Report):
    """Report of a search for viewpoints."""

    blank: bool
    """True if the pictures are blank, so that all viewpoints are alike."""
    density_scale: float | None
    entropy: float | None
    """Opacity entropy of the best view."""
    equivalent_renders: float | None
    """Wall time of the search divided by that of one picture without derivatives."""
    output: pathlib.Path
    pictures: pathlib.Path | None = None
    """Folder of the pictures; none if only cameras were asked for."""
    render_seconds: float | None
    """Wall time of one picture without derivatives."""
    report: pathlib.Path | None
    sampled_best_entropy: float | None
    sampled_seconds: float | None
    """Wall time of the samples; none without `samples`."""
    seconds: float | None
    """Wall time of the search."""
    starts: list[Start]
    stopped: bool
    """True if the search was stopped before its end."""
    up: Up
    """Axis with respect to which the cameras stand upright."""
    views: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class Accuracy(Report):
    """Noise that came in and error that is left, of the first layer, as the frames themselves tell them without a
    reference: root mean squares over pixels and channels, in the units of the colors."""

    as_it_was: float | None
    """Share of the picture, as far as it is not empty, that is much as it was: it has no noise, or the frames around do
    not show it."""
    error: float | None
    error_by_scale: float | None = None
    """Error over the scale of the radiance: the mean of the square roots of radiance, weighted by itself, and squared.
    Halves tell it."""
    error_by_scale_high: float | None = None
    """Upper end of its 95 % interval."""
    error_high: float | None
    """Upper end of the 95 % interval of the error, as far as the estimate errs by chance."""
    frames: int
    """Number of frames that it is estimated from: those that have halves, or frames on both sides."""
    gain_db: float | None
    """Decibels by which the error is below the noise."""
    noise: float | None
    noise_by_scale: float | None = None
    """Noise that came in over the scale."""
    relative_error: float | None
    """Error over the root mean square of the denoised colors."""
    told_by: str
    """Source of the estimate."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Denoised(Report):
    """Report of a denoised sequence."""

    alpha_contradicts: bool
    """True if the alpha that comes with the motion contradicts that of the pictures, which is used in its place
    then."""
    at_rest: bool
    """True if no frame had a motion other than 0."""
    cuts: list[int]
    """First frames of the shots after the first."""
    denoised: int
    estimate: Accuracy | None
    """Estimate of the noise that came in and of the error that is left; none where frames do not tell it."""
    failed: list[Failed]
    filled: int
    """Number of pixels whose color or alpha was not finite and has been filled in."""
    filled_frames: list[int]
    """Frames that have such pixels."""
    method: str
    output: str
    renewed: list[Renewed] = dataclasses.field(default_factory=list)
    """Frames that were there and were denoised again, by the input that has changed."""
    seconds: float | None
    seconds_denoising: float | None
    """Seconds of the denoising alone."""
    skipped: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class FigurePanel(Report):
    """A panel."""

    camera: dict[str, Any] | None = None
    """Camera of the picture, if it is known."""
    label: str | None = None
    picture: pathlib.Path
    scale_bar: dict[str, Any] | None = None
    size: tuple[int, ...]
    """Width and height of the picture in pixels."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Figure(Report):
    """Report of a figure."""

    columns: int
    """Number of panels in a row."""
    legend: dict[str, Any] | None = None
    length_unit: str | None = None
    """Unit of world lengths, if it is stated."""
    millimetres: tuple[float, ...]
    """Width and height in millimetres."""
    output: pathlib.Path
    panels: list[FigurePanel]
    """Panels, row by row."""
    pixels: tuple[int, ...] | None = None
    """Width and height in pixels, of a PNG."""
    remarks: list[str] = dataclasses.field(default_factory=list)
    """Remarks on what is not shown as it is stated."""
    seconds: float | None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Merged(Report):
    """Report of a joined picture."""

    accuracy: dict[str, Any] | None
    missing: str | None
    """Numbers of further replicates that the wanted error is expected to take, by the seed of their random numbers;
    null where it is reached, or none is wanted."""
    output: pathlib.Path
    pictures: int
    """Pictures that were joined."""
    replicates: str | None
    """Numbers of the joined replicates, by the seed of their random numbers; null for deep pictures."""
    samples: int | None
    """Number of samples of a deep picture; null for flat ones."""
    seconds: float | None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Motion(Report):
    """Report of the motion of frames."""

    density_scale: float | None
    """Extinction per world unit at a density of 1; none for scene files and stages, which state their own."""
    failed: list[Failed]
    frames: int
    largest: float | None
    """Largest motion from the frame before, in pixels."""
    output: str
    seconds: float | None


@dataclasses.dataclass(frozen=True, kw_only=True)
class FrameFigures(Report):
    """Figures of a frame."""

    flicker_psnr_db: float | None
    """PSNR of the change from the frame before; `null` for the first, and without any error."""
    flip: float | None = None
    frame: int
    max_abs: float | None
    psnr_db: float | None
    """`null` for identical colors."""
    rel_mse: float | None
    ssim: float | None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Comparison(Report):
    """Report of two pictures. Truth value: `not differ`."""

    alpha_max_abs: float | None = None
    """Largest absolute difference of alpha."""
    beside: dict[str, Any] | None = None
    """The sequence of `beside` against the same reference."""
    converted: str | None = None
    """Conversion of the first picture's colors to the primaries of the second."""
    differ: bool
    differences: list[str] = dataclasses.field(default_factory=list)
    """Differences between the pictures beside their samples, in words."""
    failed: list[Failed] = dataclasses.field(default_factory=list)
    """Frames that could not be read or compared."""
    flicker_psnr_db: float | None = None
    """Of the mean squared error of the changes from frame to frame."""
    flip: float | None = None
    frames: list[FrameFigures] = dataclasses.field(default_factory=list)
    heatmap_scale: float | None = None
    layers: tuple[str, ...] | None = None
    left_out: list[int] = dataclasses.field(default_factory=list)
    """Frames that not all of the sequences have."""
    max_abs: float | None
    """Largest absolute difference of a color channel."""
    non_finite_differences: int | None = None
    """Number of pixels left out in which the two pictures are not identical."""
    non_finite_pixels: int | None = None
    """Number of pixels left out because one of the pictures is NaN or infinite there."""
    peak: float | None
    """Signal peak that `psnr_db` and `ssim` refer to."""
    psnr_db: float | None
    """Peak signal-to-noise ratio in dB; infinite for identical colors, which JSON writes as `null`."""
    rel_mse: float | None
    """Relative mean squared error: the mean of (a - b)² / (b² + 0.01) over pixels and color channels."""
    report: pathlib.Path | None = None
    rms: float | None = None
    """Root mean square difference over pixels and color channels."""
    size: tuple[int, ...] | None = None
    """Width and height in pixels."""
    ssim: float | None
    """Structural similarity, mean over the color channels; 1 for identical colors."""

    def __bool__(self) -> bool:
        return not self.differ


@dataclasses.dataclass(frozen=True, kw_only=True)
class MeanTest(Report):
    """Test of the mean difference over all pixels."""

    difference: float | None
    """Mean of the first side minus that of the second."""
    freedom: float | None
    """Degrees of freedom; `null` if infinite."""
    interval: tuple[float, ...] | None
    """Interval that holds the difference of the expected means with 95 % confidence; `null` with fewer than one degree
    of freedom."""
    p: float | None
    """Two-sided probability of a larger magnitude of t."""
    t: float | None
    """Difference beyond the tolerance by its standard error; `null` if that is 0 and the difference is not."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Region(Report):
    """A pixel or tile."""

    difference: float | None
    """Mean difference."""
    freedom: float | None
    """Degrees of freedom; `null` if infinite."""
    height: int
    """Height in pixels."""
    standard_error: float | None
    """Standard error of the mean difference."""
    t: float | None
    """Difference beyond the tolerance by its standard error; `null` if that is 0 and the difference is not."""
    width: int
    """Width in pixels."""
    x: int
    """Column of the first pixel."""
    y: int
    """Row of the first pixel."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RegionTests(Report):
    """Tests of regions of one size."""

    count: int
    """Number of regions."""
    p: float | None
    """Probability that the smallest p-value of all is as small as that found (Šidák)."""
    worst: Region | None
    """Region of the smallest p-value."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SpreadTest(Report):
    """Test of the mean square of the differences against the variances."""

    mean_square: float | None
    """Mean square of the differences beyond the tolerance."""
    mean_variance: float | None
    """Mean variance, which is what the mean square is expected to be."""
    p: float | None
    """Probability of a larger z."""
    z: float | None
    """Σ w(d² - v) / √Σ w²(d² - v)²; 0 without noise and differences."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ChannelTests(Report):
    """Tests of a channel."""

    channel: str
    """Name of the channel."""
    mean: MeanTest
    """Test of the mean over the picture."""
    pixels: RegionTests
    """Tests of single pixels."""
    spread: SpreadTest
    """Test of the spread of the differences."""
    tiles: RegionTests
    """Tests of tiles."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Noise(Report):
    """Noise of a side."""

    freedom: float | None
    """Smallest degrees of freedom of a pixel's variance; `null` if they are unknown and count as infinite."""
    pictures: int
    """Number of pictures read."""
    remark: str | None = None
    """Reason to doubt the conclusion."""
    source: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class Statistics(Report):
    """Verdict on two noisy pictures with what it rests on. Truth value: `not differ`."""

    channels: list[ChannelTests]
    """Tests by channel."""
    differ: bool
    """True if a test found a difference, or pixels that are not finite are not identical."""
    false_alarm: float | None
    """Rate of false alarms that was asked for."""
    heatmap_scale: float | None = None
    left_out: int
    """Number of pixels left out because one of the sides has a sample or variance there that is not finite."""
    noise: dict[str, Any]
    non_finite_differences: int
    """Number of pixels left out whose samples are not finite and not identical."""
    p: float | None
    """Probability of a result at least as extreme if the expected values are the same, corrected for all tests."""
    size: tuple[int, ...]
    """Width and height in pixels."""
    tolerance: float | None
    """Difference of expected values that counts as none."""

    def __bool__(self) -> bool:
        return not self.differ

    @property
    def sides(self) -> tuple[Noise, Noise]:
        """Noise of the two sides."""
        return Noise.of(self.noise["a"]), Noise.of(self.noise["b"])


@dataclasses.dataclass(frozen=True, kw_only=True)
class GridDifference(Report):
    """A grid that was compared."""

    agrees_after_turn: dict[str, Any] | None = None
    """Turn of the second grid after which it agrees with the first; none if it agrees as it lies, or after no turn."""
    compared: int
    """Number of these voxels that were compared: all of them, or the part that `Effort` allows."""
    differs_beyond_f32: bool
    """True if the values are equal as 32-bit floats, in which differences are measured, but not in the grids' wider
    type."""
    incomparable: int
    """Number of values of which one is finite and the other is not, or whose kinds of infinity differ. They are left
    out of `rms` and `max_abs`."""
    max_abs: float | None
    """Largest absolute difference of a value."""
    multiple: dict[str, Any] | None
    """The multiple of A that B is nearest to; `None` if either is 0 everywhere, or they are equal."""
    name: str
    name_in_b: str | None = None
    """Name of the grid in the second file, if it differs from the name in the first."""
    psnr_db: float | None
    """PSNR in dB, `20 log10(peak / rms)` with `peak = max |A|` over active voxels; `None` if `rms` or the peak is 0."""
    rms: float | None
    """Root mean square difference over all voxels and components of the domain."""
    sampled: bool
    """True if figures are estimates from a part of the voxels. `max_abs` is the largest difference of that part."""
    topology_iou: float | None
    """Intersection over union of the topologies: voxels active in both over voxels active in either; 1 if none is
    active."""
    transform_difference: float | None
    """Largest distance in world units between the positions of a corner of the domain under the two transforms; 0 if
    equal."""
    voxels: int
    """Number of voxels of the domain."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Difference(Report):
    """Report of two files. Truth value: `same`."""

    creator: dict[str, Any] | None = None
    """Creators that the metadata state, if they differ; no difference of the grids."""
    differences: list[str]
    """Differences between the files, in words."""
    grids: list[GridDifference]
    not_compared: list[str]
    """Names of point grids in both files, which are neither same nor different."""
    of_other_kind: list[str]
    """Names of grids that hold points in one file and values in the other: a difference."""
    only_in_a: list[str]
    only_in_b: list[str]
    same: bool
    up: dict[str, Any] | None = None
    """Up axes, if they differ: a difference if both files state theirs. What states no axis is taken for Z-up."""

    def __bool__(self) -> bool:
        return self.same


@dataclasses.dataclass(frozen=True, kw_only=True)
class FileInfo(Report):
    """Content of a file, tagged in JSON with its `FileKind`."""

    error: dict[str, Any] | None = None
    """Error that kept the file, or a layer of a stage, from being read."""
    format: str | None = None
    frame: int | None = None
    """Number of the frame, of a file of a sequence."""
    path: pathlib.Path

    @property
    def grids(self) -> list[dict[str, Any]]:
        """Grids of a VDB, as the program describes them; empty for other files."""
        return list(self.extra.get("grids", []))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Files(Report):
    """Report of what is in files."""

    files: list[FileInfo]
    """Files in the order in which they were given; those of sequences frame by frame."""
    sequences: list[dict[str, Any]] = dataclasses.field(default_factory=list)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sheet(Report):
    """A sheet of a file."""

    exposure: float | None
    """Exposure of the picture in stops."""
    input: pathlib.Path
    output: pathlib.Path | None
    """PNG that was written; none if the sheet was only shown."""
    shows: str
    size: tuple[int, ...]
    """Width and height of the sheet in pixels."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Viewed(Report):
    """Report on contact sheets."""

    failed: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    """Files without a sheet."""
    sheets: list[Sheet]


@dataclasses.dataclass(frozen=True, kw_only=True)
class FileFindings(Report):
    """Findings of the check of a file."""

    error: dict[str, Any] | None = None
    """Error that kept the file from being read."""
    findings: list[dict[str, Any]]
    format: str | None
    """Format of the file; none if it could not be read."""
    frame: int | None = None
    """Number of the frame, of a file of a sequence."""
    path: pathlib.Path
    valid: bool


@dataclasses.dataclass(frozen=True, kw_only=True)
class Validation(Report):
    """Report of what is wrong with files, and what to do. Truth value: `valid`."""

    files: list[FileFindings]
    """Files in the order in which they were given; those of sequences frame by frame."""
    sequences: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    valid: bool

    def __bool__(self) -> bool:
        return self.valid


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArrayGrid(Report):
    """Where a grid's voxels lie, and what its values are."""

    active_voxels: int
    background: tuple[float, ...]
    """Value outside."""
    class_: str
    greatest: float | None
    """Largest finite value."""
    index_origin: tuple[int, ...]
    """Index coordinates of the array's voxel [0, 0, 0]."""
    least: float | None
    """Smallest finite value, the background's 0 included if a voxel has it."""
    name: str
    non_finite: int
    """Number of values that are NaN or infinite."""
    overflowed: int
    """Number of finite values that become infinite as 32-bit floats."""
    removed: int
    """Number of values other than 0 that the threshold made background."""
    removed_greatest: float | None
    """Largest value that the threshold made background."""
    removed_share: float | None
    """Share of the sum of all magnitudes that the threshold removed."""
    rounded: int
    """Number of whole numbers beyond 2²⁴ that the grid's 32-bit floats round."""
    shape: tuple[int, ...]
    """Number of voxels along x, y and z."""
    transform: tuple[tuple[float, ...], ...]
    """Matrix from the array's indices to the world, row by row, acting on columns; indices are those of centres."""
    value_type: str
    """OpenVDB's name for the type of the values."""
    vanished: int
    """Number of values other than 0 that become 0 as 32-bit floats."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArrayLayer(Report):
    """Layer of a picture that became an array."""

    channels: list[str]
    name: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class Converted(Report):
    """Report of a VDB with edits, of a mesh, or of an image, an array or a NanoVDB."""

    axes: tuple[str, ...] | None = None
    """Names of the array's axes."""
    bytes: int
    format: str | None = None
    """Format of the mesh."""
    grid: ArrayGrid | None = None
    """The grid that was read or written."""
    grids: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    half_width: float | None = None
    """Width of the narrow band to each side in voxels, in which a mesh became distances; none to a mesh."""
    input: pathlib.Path
    iso: float | None = None
    """Value of the grid on the surface that became a mesh; none from a mesh."""
    layer: ArrayLayer | None = None
    """Layer that was read, with its channels in the array's order."""
    mesh: dict[str, Any] | None = None
    """The mesh that was read or written."""
    more: list[pathlib.Path] = dataclasses.field(default_factory=list)
    """Other files whose grids were joined with those of the first one."""
    notes: list[str] = dataclasses.field(default_factory=list)
    """Sentences on what may have been meant otherwise."""
    output: pathlib.Path
    shape: tuple[int, ...] | None = None
    """Lengths of the array's axes; empty for several arrays."""
    tone_mapping: dict[str, Any] | None = None
    """How radiance became the samples of a PNG."""
    transfer: dict[str, Any] | None = None
    """Transfer function that `tf` attached to the grids."""
    up: dict[str, Any] | None = None
    """Turn of the world that `up` asked for."""
    warnings: list[str] = dataclasses.field(default_factory=list)
    """Edits whose effect may not have been meant."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Effect(Report):
    """Plan of an effect."""

    bound: float | None
    """Upper bound of the radiance that is left out in any channel of a pixel; for an effect that is on, of what would
    be missing without it. None where nothing finite is known."""
    contribution: dict[str, Any] | None
    """Radiance that the part which is left out adds to the pictures; for an effect that is on, all of it, and of
    multiple scattering what is scattered more than once. None where it was not measured."""
    cost: float | None
    """Seconds a picture that it takes, as far as a `pilot` has told."""
    name: str
    """Effect."""
    reason: str
    """Why."""
    state: str
    """State of the effect."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Plan(Report):
    """Report of the plan of pictures."""

    confidence: float | None
    """Confidence of that bound: 1 if it is proved, less if some of it was measured."""
    cost: dict[str, Any]
    effects: list[Effect]
    """Effects."""
    input: pathlib.Path
    integrator: str
    """How light is integrated."""
    measured: dict[str, Any]
    """Measurements."""
    omitted: float | None
    """Upper bound of the radiance that is left out in any channel of a pixel; none where nothing finite is known. With
    a confidence below 1 it bounds the means of the pictures' blocks of 8 x 8 pixels."""
    size: tuple[int, ...]
    up: Up | None
    """Up axis about which cameras were placed; none where they were given."""
    views: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlannedStage(Report):
    """A stage of a plan."""

    name: str
    """Name that the report of the run gives the stage."""
    range: tuple[float, ...]
    """Least and longest time in seconds."""
    seconds: float | None
    """Expected wall time in seconds."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlannedMemory(Report):
    """Memory of a plan."""

    allowed_mb: float | None
    """Memory that `max_memory` allows, in MB."""
    fits: bool
    """True if the reconstruction fits."""
    needed_mb: float | None
    """Memory that each machine needs, in MB (2²⁰ bytes): every process holds all pictures and all voxels."""
    smallest_voxel_size: float | None
    """Smallest edge of voxels that fits, in world units; none where the pictures alone do not."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class MachineTime(Report):
    """Time of a reconstruction on a number of machines."""

    efficiency: float | None
    """Time on one machine over the machines' times together, 0 to 1."""
    machines: int
    """Number of machines, each with one process."""
    seconds: float | None
    """Expected wall time in seconds."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlannedScaling(Report):
    """Time of a plan on several machines."""

    alone_seconds: float | None
    """Seconds of one machine that more machines do not shorten."""
    bandwidth: float | None
    """Bandwidth in Gbit/s."""
    delay: float | None
    """Part of the time between two exchanges that varies."""
    latency: float | None
    """Latency in µs."""
    machines: list[MachineTime]
    """Time and efficiency by the number of machines."""
    partitions: int
    """Partitions of the rays of the finest level: no more threads work on a pass, whatever the number of machines."""
    useful_machines: int
    """Number of machines beyond which none has a partition of its own left to do."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReconstructionPlan(Report):
    """Report of the plan of a reconstruction."""

    capture: pathlib.Path
    """Path of the pictures' transforms.json."""
    expected: dict[str, Any]
    """Unknowns, pixels, memory and expected time of the whole run."""
    held_out: list[int]
    """Numbers of the held-out views."""
    iterations: tuple[float, ...] | None
    """Fewest, expected and most iterations over all levels; none where the solver counts otherwise."""
    memory: PlannedMemory
    """Memory beside what a machine has."""
    read: int
    """Number of pictures whose pixels were read; of the others only headers were."""
    scaling: PlannedScaling | None
    """Time on several machines; none for solvers without a model of it."""
    seconds_range: tuple[float, ...] | None
    """Least and longest time in seconds: held-out views decide when the search ends. Without a range the time is right
    within a factor of a few only."""
    solver: str
    """Solver that the reconstruction uses."""
    stages: list[PlannedStage]
    """Expected stages in the order of the work."""
    threads: int
    """Threads that the times hold for."""
    timed_level: int | None
    """Level that was timed on this machine, 0 the finest; none where times are those of a usual machine."""
    views: int
    """Number of pictures."""
    voxel_size: tuple[float, ...]
    """Edge lengths of the voxels in world units."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Derivative(Report):
    """A parameter with its derivative."""

    difference: float | None = None
    gradient: float | None
    name: str
    relative_error: float | None = None
    rounding: float | None = None
    """Error of the difference quotient that rounding of the loss alone may have made."""
    standard_error: float | None = None
    """Standard error of a derivative that is estimated."""
    value: float | None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Gradient(Report):
    """Report of derivatives, and of their check."""

    adjoint: str | None
    checked: int | None = None
    """Number of listed parameters that have a difference quotient; none if they are not checked."""
    input: pathlib.Path
    loss: str
    mode: str
    output: pathlib.Path | None
    parameters: int
    """Number of parameters; of the voxels, only the largest derivatives are listed."""
    precision: str
    provenance: Provenance | None
    quadrature: str
    reason: str
    report: pathlib.Path | None = None
    """Path of the page; none if none was written."""
    rows: list[Derivative]
    seconds: float | None
    tolerance: float | None
    up: Up | None
    """Up axis about which cameras were placed; none where the target states them."""
    value: float | None
    views: int
    warnings: list[Caution]
    """Contradictions between the pictures and the model."""
    worst_relative_error: float | None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Transfer(Report):
    """A transfer function that was read."""

    albedo: dict[str, Any] | None
    """Albedo that the function states beside its colors."""
    empty_at_zero: bool
    """True if density 0 absorbs nothing, so that empty space can be skipped."""
    entries: int
    """Number of texels, points, lobes or classes; 1 for an identity."""
    input: pathlib.Path
    kind: str
    """Kind of function: `texture`, `piecewise`, `gaussians`, `identity` or `labels`."""
    name: str | None
    notes: list[str]
    output: pathlib.Path | None
    parameters: int
    """Number of parameters that can be optimised."""
    peak_color: tuple[float, ...]
    """Greatest radiance of the source, by color channel."""
    peak_extinction: float | None
    """Greatest extinction, per world unit."""
    presets: list[str]
    range: tuple[float, ...]
    """First and last density of the function's range."""
    source: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class SuggestedBoundary(Report):
    """A boundary with its number."""

    gradient: float | None
    """Mean magnitude of the gradient at the boundary, per world unit."""
    half_width: float | None
    """Distance of the values on either side at which the mean gradient has fallen to half."""
    number: int
    """Number from 1, as names of candidates have it."""
    share: float | None
    """Share of the voxels whose values lie within the half width."""
    thickness: float | None
    """Thickness in voxels: twice the standard deviation of the blur that would make a step look like it."""
    value: float | None
    """Value halfway between the materials."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Material(Report):
    """A material: the most frequent value between two boundaries."""

    share: float | None
    """Share of the voxels between the boundaries."""
    value: float | None
    """Most frequent value."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SuggestedFunction(Report):
    """A function that suits the volume."""

    albedo: dict[str, Any] | None
    """Albedo that the function states beside its colors."""
    effect: str
    """Effect on the volume."""
    empty_at_zero: bool
    """True if density 0 absorbs nothing, so that empty space can be skipped."""
    entries: int
    """Number of texels, points, lobes or classes; 1 for an identity."""
    kind: str
    """Kind of function: `texture`, `piecewise`, `gaussians`, `identity` or `labels`."""
    name: str
    """Name by what it shows: `all boundaries`, `boundary 1` and so on, or `ramp`."""
    number: int
    """Number from 1, as `candidate` takes it."""
    parameters: int
    """Number of parameters that can be optimised."""
    peak_color: tuple[float, ...]
    """Greatest radiance of the source, by color channel."""
    peak_extinction: float | None
    """Greatest extinction, per world unit."""
    range: tuple[float, ...]
    """First and last density of the function's range."""
    visible: float | None
    """Share of the picture over the volume's box in which something is to be seen."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Suggestion(Report):
    """Transfer functions that suit a volume."""

    background: float | None
    """Value of most of the border of the volume's box; no function absorbs there."""
    boundaries: list[SuggestedBoundary]
    """Boundaries between materials, in ascending order of value."""
    candidate: int
    """Number of the candidate that was chosen, from 1."""
    candidates: list[SuggestedFunction]
    """Functions that suit the volume."""
    cells: int
    """Number of cells between voxels, in whose middles values and gradients were taken."""
    grid: str
    """Name of the grid."""
    materials: list[Material]
    """Materials between the boundaries, in ascending order of value."""
    output: pathlib.Path | None
    """Transfer function that was written."""
    range: tuple[float, ...]
    """Values between which all but the least and the greatest 0.1 % of the voxels lie."""
    sheet: pathlib.Path | None
    """Sheet of all candidates that was written."""
    suggest: pathlib.Path
    """Volume that was looked at."""
    warnings: list[Caution]
    """Remarks on the function that was chosen."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Preset(Report):
    """Description of a transfer function that is chosen by name."""

    colors: str
    """Colors from the low end to the high one, in words."""
    name: str
    """Name, as `tf` takes it."""
    opacity: str
    """How opacity or extinction depends on the density, in words."""
    range: tuple[float, ...]
    """Densities at its two ends."""
    source: str
    """Origin of colors and ranges."""
    unit: str
    """Unit of the densities: `HU` for Hounsfield units, or empty."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Presets(Report):
    """The transfer functions that are there by name."""

    functions: list[Preset]


@dataclasses.dataclass(frozen=True, kw_only=True)
class AuthoredVolume(Report):
    """A volume of the stage."""

    bounds: tuple[tuple[float, ...], ...] | None
    """World-space box around all frames; none if there is nothing to be seen."""
    fields: list[str]
    """Names of the grids."""
    files: int
    prim: str
    """Path of the prim."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Authored(Report):
    """Report on a stage that was written."""

    cameras: int
    frames: tuple[int, ...] | None
    lights: int
    meshes: int
    output: pathlib.Path
    provenance: Provenance
    up: Up
    """Up axis of the stage."""
    volumes: list[AuthoredVolume]
    warnings: list[Caution]


@dataclasses.dataclass(frozen=True, kw_only=True)
class LintFinding(Report):
    """A finding about a stage."""

    do: str
    """Advice to the user."""
    fixed: bool
    """True if the layer removes it."""
    id: str
    """Kind of finding, which stays the same from release to release."""
    prim: str | None
    """Path of the prim; `None` if the finding concerns the whole stage."""
    severity: str
    """Severity."""
    what: str
    """Description of the fault: what was found, and what was expected."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class LintedStage(Report):
    """Findings of the check of a stage."""

    error: dict[str, Any] | None = None
    """Error that kept the stage from being read."""
    findings: list[LintFinding]
    path: pathlib.Path


@dataclasses.dataclass(frozen=True, kw_only=True)
class Linted(Report):
    """Report on stages. Notes do not count as problems. Truth value: `clean`."""

    clean: bool
    """True if no stage has a problem that is left."""
    layer: pathlib.Path | None
    """Layer that was written; none if nothing could be fixed."""
    stages: list[LintedStage]

    def __bool__(self) -> bool:
        return self.clean
