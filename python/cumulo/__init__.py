"""The Python side of Cumulo: thin over the program's `--json`.

    import cumulo
    made = cumulo.render("smoke.vdb", "shots", views=32, density_scale="auto")
    found = cumulo.reconstruct.density(made.output, "found.vdb")
    print(found.train_psnr_db, cumulo.diff("smoke.vdb", "found.vdb").grids[0].psnr_db)

Functions run one command each and return its report as a dataclass (`results`). What the program refuses
raises `CumuloError` with its message and its hint; a check that finds a difference is a result, not an
error. `arrays` turns grids and pictures into NumPy arrays and back, `plots` draws reports with
matplotlib (`pip install cumulo[plots]`), `testing` is a pytest plugin for render regression tests.

`capture` reads and writes multi-view captures, `exr` pictures; `transfer` has transfer functions, of Blender's color ramps
too, and `usd` writes and checks stages.
Modules that need Blender's `bpy` or what comes with it (`pip install cumulo[blender]`): `blender`
renders volumes with Cycles by the parts in `cycles`, `bpy_scene` turns Blender's scenes into scene files
and captures, `noise` measures how noisy pictures of Cycles are, `padding` surrounds volumes with the
empty voxels that Cycles needs.
"""

from . import reconstruct, transfer, usd
from .commands import (
    compare,
    compare_statistical,
    convert,
    convert_capture,
    denoise,
    diff,
    figure,
    gradient,
    info,
    merge,
    motion,
    plan,
    pose,
    render,
    validate,
    view,
    viewpoint,
)
from .run import CumuloError, program

__version__ = "0.1.0"
"""Version of the package, which is that of the program that it was written for."""

__all__ = [
    "CumuloError",
    "__version__",
    "compare",
    "compare_statistical",
    "convert",
    "convert_capture",
    "denoise",
    "diff",
    "figure",
    "gradient",
    "info",
    "merge",
    "motion",
    "plan",
    "pose",
    "program",
    "reconstruct",
    "render",
    "transfer",
    "usd",
    "validate",
    "view",
    "viewpoint",
]
