"""Reports of the program as dataclasses.

Fields have the names of the JSON's keys. Keys that a class does not know (of a newer program) are kept in
`extra`, and `json` is the report as it came. Paths are `pathlib.Path`; lengths are in world units,
positions and matrices in world space, matrices row by row and acting on columns, times in seconds.
"""

from __future__ import annotations

import dataclasses
import pathlib
from typing import Any

from .comparisons import (
    ChannelTests,
    Comparison,
    Difference,
    FrameFigures,
    GridDifference,
    MeanTest,
    Noise,
    Region,
    RegionTests,
    SpreadTest,
    Statistics,
)
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
    "MeanTest",
    "Motion",
    "Noise",
    "Plan",
    "Posed",
    "PosedCamera",
    "Preset",
    "Presets",
    "Provenance",
    "Reconstruction",
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
    "Transfer",
    "TransferFunction",
    "Up",
    "Validation",
    "Viewed",
    "Viewpoints",
]

Matrix = tuple[tuple[float, ...], ...]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Caution(Report):
    """Something that makes a result doubtful: `what`, and what to `do`."""

    what: str
    do: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class Failed(Report):
    """A frame without a result."""

    frame: int
    error: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class Stage(Report):
    """A stage of the work and the seconds that it took."""

    name: str
    seconds: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class Provenance(Report):
    """What made a file: `inputs` are SHA-256 sums by path, `settings` one of what the result depends on."""

    software: str
    command: str
    inputs: dict[str, str]
    use_case: str = ""
    settings: str = ""
    seconds: float | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Up(Report):
    """Up axis, "Y" or "Z", and why it was taken."""

    axis: str
    reason: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class Rendered(Report):
    """Pictures of `cumulo.render`: `output` is the folder with the EXRs and transforms.json.

    `paths` counts paths and collisions where light scatters, `plan` says which effects were simulated.
    """

    output: pathlib.Path
    views: int
    model: str
    density_scale: float | None = None
    density_scales: list[float] | None = None
    tone_mapping: dict[str, Any] | None = None
    quadrature: str | None = None
    quadrature_error_bound: float | None = None
    early_stop: dict[str, Any] | None = None
    paths: dict[str, Any] | None = None
    plan: dict[str, Any] | None = None
    sky: Any = None
    up: Up | None = None
    seconds: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class Iteration(Report):
    """A step of a reconstruction; `seconds` since the beginning. Volumes have a `loss` and a `level` of resolution,
    transfer functions an `rms` of the pictures and the weight `smooth` of their prior."""

    iteration: int
    loss: float | None = None
    rms: float | None = None
    smooth: float | None = None
    level: int | None = None
    seconds: float | None = None
    held_out_psnr_db: float | None = None

    @property
    def objective(self) -> float | None:
        """The loss, or the RMS."""
        return self.rms if self.loss is None else self.loss


@dataclasses.dataclass(frozen=True, kw_only=True)
class Reconstruction(Report):
    """A reconstruction: a VDB of densities or of a pre-shaded volume.

    PSNRs are of pictures (peak 1); `held_out` lists the views that were not fitted. `stopped`: by Ctrl-C,
    with what there was written. `cameras` tells how far refined cameras moved. `history` has the loss by iteration.
    """

    capture: pathlib.Path
    output: pathlib.Path
    solver: str
    grid: str | None
    layer: str | None
    iterations: int
    seconds: float
    train_psnr_db: float | None
    held_out_psnr_db: float | None
    peak_memory_mb: float | None
    stopped: bool
    views: int
    held_out: list[int]
    shown: list[int]
    voxel_size: tuple[float, ...]
    unknowns: int
    expected: dict[str, Any] | None = None
    cameras: dict[str, Any] | None = None
    warnings: list[Caution] = dataclasses.field(default_factory=list)
    report: pathlib.Path | None = None
    stages: list[Stage] = dataclasses.field(default_factory=list)
    history: list[Iteration] = dataclasses.field(default_factory=list)
    provenance: Provenance | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class TransferFunction(Report):
    """A reconstructed transfer function (`output`, .tf.json) of `texels` texels over the densities `domain`.

    `confidence` has a pair for each texel, of its extinction and its colors, from 0 to 1.
    """

    capture: pathlib.Path
    volume: pathlib.Path
    output: pathlib.Path
    grid: str | None
    solver: str
    layer: str | None
    texels: int
    domain: tuple[float, ...]
    smooth: float | None
    iterations: int
    seconds: float
    train_rms: float | None
    views: int
    held_out: list[int]
    shown: list[int]
    held_out_psnr_db: float | None
    held_out_ssim: float | None
    quadrature: str
    peak_memory_mb: float | None
    stopped: bool
    expected: dict[str, Any] | None = None
    warnings: list[Caution] = dataclasses.field(default_factory=list)
    report: pathlib.Path | None = None
    confidence: list[tuple[float, ...]] = dataclasses.field(default_factory=list)
    stages: list[Stage] = dataclasses.field(default_factory=list)
    history: list[Iteration] = dataclasses.field(default_factory=list)
    provenance: Provenance | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class PosedCamera(Report):
    """A camera before and after: RMS of its picture, and how far it turned (degrees) and moved (percent of its distance)."""

    picture: str
    rms_before: float
    rms_after: float
    rotated_degrees: float
    moved_percent: float
    iterations: int
    undetermined: int
    unexplained_variance: float | None = None
    note: str | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Posed(Report):
    """Corrected cameras; `output` is the new capture's JSON."""

    output: pathlib.Path
    cameras: list[PosedCamera]
    rms_before: float
    rms_after: float
    iterations: int
    focal_factor: float | None = None
    seconds: float
    stopped: bool = False
    warnings: list[Caution] = dataclasses.field(default_factory=list)
    report: pathlib.Path | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Start(Report):
    """A local search: unit directions from the volume to the camera, and the entropy at its end."""

    start: tuple[float, ...]
    end: tuple[float, ...]
    entropy: float
    iterations: int
    view: int | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Viewpoints(Report):
    """Cameras from which a volume shows most; `output` is a capture's JSON, the best first."""

    output: pathlib.Path
    pictures: pathlib.Path | None = None
    views: int
    entropy: float
    sampled_best_entropy: float | None = None
    starts: list[Start]
    blank: bool
    stopped: bool
    density_scale: float
    seconds: float
    sampled_seconds: float | None = None
    render_seconds: float
    equivalent_renders: float
    up: Up | None = None
    report: pathlib.Path | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Renewed(Report):
    """Frames that were there and were made again, since `input` has changed."""

    input: pathlib.Path
    frames: list[int]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Accuracy(Report):
    """Noise that came in and error that is left, as frames tell them without a reference: root mean squares."""

    frames: int
    noise: float
    error: float
    error_high: float
    """Upper end of the 95 % interval of the error, as far as the estimate errs by chance."""
    gain_db: float
    relative_error: float
    as_it_was: float
    """Share of the picture that is much as it was."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Denoised(Report):
    """A denoised sequence; `output` is the pattern of its frames' names."""

    output: str
    method: str
    denoised: int
    skipped: int
    renewed: list[Renewed] = dataclasses.field(default_factory=list)
    failed: list[Failed]
    cuts: list[int]
    filled: int
    filled_frames: list[int]
    at_rest: bool
    alpha_contradicts: bool
    estimate: Accuracy | None = None
    seconds: float
    seconds_denoising: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class Motion(Report):
    """Motion of a sequence; `largest` in pixels, `output` is the pattern of the frames' names."""

    output: str
    frames: int
    failed: list[Failed]
    largest: float
    density_scale: float | None
    seconds: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class FileInfo(Report):
    """What is in a file; `format` is "vdb", "exr" or "capture", and `extra` holds the keys of that format:
    `grids`, `parts` or `frames`."""

    path: pathlib.Path
    format: str

    @property
    def grids(self) -> list[dict[str, Any]]:
        """Grids of a VDB, as the program describes them; empty for other files."""
        return list(self.extra.get("grids", []))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Files(Report):
    """What is in several files."""

    files: list[FileInfo]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sheet(Report):
    """A contact sheet: `shows` is "volume", "picture", "capture" or "sequence", `size` the sheet's width and height in
    pixels, and `extra` holds the keys of that kind."""

    input: pathlib.Path
    output: pathlib.Path | None
    size: tuple[int, ...]
    shows: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class Viewed(Report):
    """Contact sheets of `cumulo.view`, one for each file that could be shown."""

    sheets: list[Sheet]
    failed: list[dict[str, Any]] = dataclasses.field(default_factory=list)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Transfer(Report):
    """A transfer function: `range` are its first and last density, `peak_extinction` is per world unit, `empty_at_zero`
    says that density 0 absorbs nothing. `output` is the `.tf.json` that was written."""

    input: pathlib.Path
    output: pathlib.Path | None
    source: str
    name: str | None
    kind: str
    entries: int
    parameters: int
    range: tuple[float, ...]
    peak_extinction: float
    peak_color: tuple[float, ...]
    empty_at_zero: bool
    presets: list[str]
    notes: list[str]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Preset(Report):
    """A transfer function that is there by name: the densities at its ends, their `unit` (such as "HU"), and in words
    its colors, its opacity and where it comes from."""

    name: str
    range: tuple[float, ...]
    unit: str
    colors: str
    opacity: str
    source: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class Presets(Report):
    """Transfer functions that are there by name."""

    functions: list[Preset]


@dataclasses.dataclass(frozen=True, kw_only=True)
class AuthoredVolume(Report):
    """A volume of a stage: the path of its prim, the number of its files, the names of its grids, and the box (low, high)
    around all frames."""

    prim: str
    files: int
    fields: list[str]
    bounds: Matrix | None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Authored(Report):
    """A stage of `cumulo.usd.author`; `frames` are the first and the last."""

    output: pathlib.Path
    frames: tuple[int, ...] | None
    volumes: list[AuthoredVolume]
    cameras: int
    lights: int
    up: Up | None = None
    warnings: list[Caution] = dataclasses.field(default_factory=list)
    provenance: Provenance | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class LintFinding(Report):
    """A finding about a stage: its stable `id`, the prim, `what` is wrong and what to `do`; notes do not count as faults.
    `fixed`: the layer that was written removes it."""

    id: str
    severity: str
    prim: str | None
    what: str
    do: str
    fixed: bool


@dataclasses.dataclass(frozen=True, kw_only=True)
class LintedStage(Report):
    """What is wrong with a stage."""

    path: pathlib.Path
    findings: list[LintFinding]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Linted(Report):
    """What is wrong with stages; `layer` is the one that was written. Truth value: nothing is wrong that is left."""

    clean: bool
    stages: list[LintedStage]
    layer: pathlib.Path | None

    def __bool__(self) -> bool:
        return self.clean


@dataclasses.dataclass(frozen=True, kw_only=True)
class FileFindings(Report):
    """What is wrong with a file."""

    path: pathlib.Path
    format: str | None = None
    valid: bool
    findings: list[dict[str, Any]]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Validation(Report):
    """What is wrong with files. Truth value: nothing is."""

    valid: bool
    files: list[FileFindings]

    def __bool__(self) -> bool:
        return self.valid


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArrayGrid(Report):
    """Place of a grid's array: indices of its voxel [0, 0, 0] in the grid, and the [4][4] matrix from the array's
    indices to the world."""

    name: str
    class_: str = ""
    index_origin: tuple[int, ...]
    transform: Matrix
    background: tuple[float, ...]
    active_voxels: int
    value_type: str = ""
    shape: tuple[int, ...] = ()
    least: float | None = None
    greatest: float | None = None
    non_finite: int = 0
    removed: int = 0
    removed_greatest: float | None = None
    removed_share: float = 0.0
    rounded: int = 0
    overflowed: int = 0
    vanished: int = 0


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArrayLayer(Report):
    """Layer that an array was made of, with its channels in the array's order."""

    name: str
    channels: list[str]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Converted(Report):
    """A converted file: `grids` of a VDB that was written; `shape`, `axes`, and `grid` or `layer` of the only array."""

    input: pathlib.Path
    output: pathlib.Path
    bytes: int
    more: list[pathlib.Path] = dataclasses.field(default_factory=list)
    grids: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    transfer: dict[str, Any] | None = None
    warnings: list[str] = dataclasses.field(default_factory=list)
    up: dict[str, Any] | None = None
    shape: tuple[int, ...] | None = None
    axes: tuple[str, ...] | None = None
    grid: ArrayGrid | None = None
    layer: ArrayLayer | None = None
    format: str | None = None
    tone_mapping: dict[str, Any] | None = None
    notes: list[str] = dataclasses.field(default_factory=list)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Effect(Report):
    """An effect: "on" or "off", why, what it costs (seconds) and how much radiance it adds at most."""

    name: str
    state: str
    reason: str
    cost: float | None
    bound: float | None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Plan(Report):
    """What `cumulo.render` would simulate: `omitted` bounds the radiance left out, `measured` is what a pilot found."""

    input: pathlib.Path
    views: int
    size: tuple[int, ...]
    integrator: str
    effects: list[Effect]
    omitted: float | None = None
    measured: dict[str, Any] = dataclasses.field(default_factory=dict)
    cost: dict[str, Any]
    up: Up | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Derivative(Report):
    """A parameter and the loss's derivative with respect to it; `difference` is the difference quotient of a check."""

    name: str
    value: float
    gradient: float
    difference: float | None = None
    rounding: float | None = None
    relative_error: float | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Gradient(Report):
    """A loss on pictures of a volume and its derivatives."""

    input: pathlib.Path
    loss: str
    value: float
    parameters: int
    mode: str
    adjoint: str | None = None
    reason: str
    precision: str
    quadrature: str
    views: int
    up: Up | None = None
    rows: list[Derivative]
    checked: int | None = None
    worst_relative_error: float | None = None
    warnings: list[Caution] = dataclasses.field(default_factory=list)
    tolerance: float | None = None
    output: pathlib.Path | None = None
    report: pathlib.Path | None = None
    seconds: float | None = None
    provenance: Provenance | None = None
