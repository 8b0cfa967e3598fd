"""Cumulo in Python: volumes between OpenVDB, Blender, USD and EXR, rendered, differentiated and reconstructed.

    import cumulo
    made = cumulo.render("smoke.vdb", "shots", views=32, density_scale="auto")
    found = cumulo.reconstruct.density(made.output, "found.vdb")
    print(found.train_psnr_db, cumulo.diff("smoke.vdb", "found.vdb").grids[0].psnr_db)

Functions run one command each, in this process, and return its report as a dataclass (`results`). What is refused
raises `CumuloError` with its `code`, `path` and `remedy`; a check that finds a difference is a result, not an error.

`arrays` reads and writes grids and pictures as NumPy arrays. `pictures` renders arrays and gives derivatives, `torch`
makes that an operation of PyTorch (`import cumulo.torch`), and `fields` says what arrays stand for: `Lattice`, `Cameras`
and transfer functions. `plots` draws reports with matplotlib (`pip install cumulo[plots]`), `testing` is a pytest plugin
for render regression tests.

`capture` reads and writes multi-view captures, `exr` pictures; `transfer` has transfer functions, of Blender's color ramps
too, and `usd` writes and checks stages.
Modules that need Blender's `bpy` or what comes with it (`pip install cumulo[blender]`): `blender`
renders volumes with Cycles by the parts in `cycles`, `bpy_scene` turns Blender's scenes into scene files
and captures, `noise` measures how noisy pictures of Cycles are, `padding` surrounds volumes with the
empty voxels that Cycles needs.
"""

import importlib as _importlib
import os as _os
import sys as _sys
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

from . import _native, reconstruct, transfer, usd
from .commands import (
    call,
    compare,
    compare_statistical,
    convert,
    convert_capture,
    denoise,
    diff,
    figure,
    gradient,
    help,
    info,
    merge,
    motion,
    plan,
    plan_reconstruction,
    pose,
    render,
    validate,
    view,
    viewpoint,
)
from .errors import CumuloError

if _TYPE_CHECKING:
    from .fields import Cameras, Gaussians, Lattice, Piecewise, Texture

__version__ = _native.__version__
"""Version of the package."""

__all__ = [
    "Cameras",
    "CumuloError",
    "Gaussians",
    "Lattice",
    "Piecewise",
    "Texture",
    "__version__",
    "call",
    "compare",
    "compare_statistical",
    "convert",
    "convert_capture",
    "denoise",
    "diff",
    "figure",
    "gradient",
    "help",
    "info",
    "merge",
    "motion",
    "plan",
    "plan_reconstruction",
    "pose",
    "reconstruct",
    "render",
    "transfer",
    "usd",
    "validate",
    "view",
    "viewpoint",
]

# Grids of points are tried in a process of their own before they are read here. That process may not find the package
# by itself: its folder may be on this one's path alone.
_place = _os.path.dirname(_os.path.dirname(_os.path.abspath(__file__)))
_helper = ["-P", "-c", f"import sys; sys.path.insert(0, {_place!r}); from cumulo.__main__ import main; main()"]
if _sys.executable:
    _native.set_helper(_sys.executable, _helper)


def __getattr__(name: str) -> _Any:
    """What takes long to import, NumPy above all, is imported when it is asked for."""
    if name in ("arrays", "capture", "exr", "fields", "pictures", "plots", "results"):
        return _importlib.import_module(f"{__name__}.{name}")
    if name in ("Cameras", "Gaussians", "Lattice", "Piecewise", "Texture"):
        return getattr(_importlib.import_module(f"{__name__}.fields"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
