"""Grids and pictures as NumPy arrays. The library reads and writes the files.

Axis order: volumes are `array[x, y, z]` (vectors `array[x, y, z, component]`), pictures
`array[row, column, channel]` with row 0 at the top, scene-linear and premultiplied. All are float32.
"""

from __future__ import annotations

import dataclasses
import os
import pathlib
import tempfile
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _native
from .commands import convert
from .errors import CumuloError
from .options import Option, Path

Array = npt.NDArray[np.float32]
Matrix = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Volume:
    """A grid over the box of its active voxels.

    `values`: [x, y, z] or [x, y, z, 3] float32. `transform`: [4, 4] float64, from the array's indices (those of
    voxel centres) to the world, acting on columns. `index_origin`: index coordinates in the file of voxel
    [0, 0, 0]. `background`: the value outside, one per component.
    """

    values: Array
    transform: Matrix
    name: str = "density"
    index_origin: tuple[int, ...] = (0, 0, 0)
    background: tuple[float, ...] = (0.0,)

    def world(self, index: npt.ArrayLike) -> Matrix:
        """World positions, [..., 3], of array indices, [..., 3]."""
        at = np.asarray(index, dtype=np.float64)
        return np.asarray(at @ self.transform[:3, :3].T + self.transform[:3, 3], dtype=np.float64)


@dataclasses.dataclass(frozen=True)
class Picture:
    """A layer: `values` [row, column, channel] float32, and the names of its channels."""

    values: Array
    channels: tuple[str, ...] = ("R", "G", "B", "A")
    layer: str = ""


def read_volume(path: Path, grid: str | None = None, *, max_memory: int | str | None = None, **scan: Option) -> Volume:
    """Reads a grid of a VDB, a NanoVDB or a scan: the named one, the only one, or `density`.

    `max_memory` bounds the array's bytes (2**31, or "2G"; default: half of the machine's memory). `scan` are the options
    of `cumulo convert` that place scans: `voxel_size`, `origin`, `transform`, `time_point` and the like.
    Raises `CumuloError` if the file or the grid cannot be read, or the array would exceed `max_memory`.
    """
    if scan or isinstance(max_memory, str):
        return _converted(path, grid, {**scan, "max_memory": max_memory})
    values, transform, name, low, background = _native.read_volume(path, grid, max_memory)
    return Volume(values, np.array(transform), name, tuple(low), tuple(background))


def _converted(path: Path, grid: str | None, options: dict[str, Any]) -> Volume:
    """Reads a grid by a conversion, which takes all options."""
    with tempfile.TemporaryDirectory(prefix="cumulo-") as folder:
        array = pathlib.Path(folder) / "grid.npy"
        made = convert(path, array, grid=grid, **options)
        values = np.load(array)
    if made.grid is None:
        raise CumuloError("invalid", "this is no volume", os.fspath(path), None, "read pictures with cumulo.arrays.read_picture")
    return Volume(values, np.array(made.grid.transform), made.grid.name, made.grid.index_origin, made.grid.background)


def write_volume(path: Path, values: npt.ArrayLike, *, voxel_size: float | None = None,
                 origin: tuple[float, float, float] | None = None, transform: npt.ArrayLike | None = None,
                 grid: str = "density", **options: Any) -> None:  # fmt: skip
    """Writes an array as the only grid of a VDB; zeros become inactive.

    Give `voxel_size` (world units), and with it `origin`, the world position of the centre of voxel
    [0, 0, 0]; or `transform`, [4, 4] from indices to the world. Raises `CumuloError` if it cannot be written.
    """
    place: dict[str, Option] = {"voxel_size": voxel_size, "origin": origin}
    if transform is not None:
        rows = np.asarray(transform, dtype=np.float64)[:3].ravel().tolist()
        place["transform"] = tuple(rows)
    _through(path, values, {**place, "grid": grid, **options})


def read_picture(path: Path, layer: str | None = None, **options: Any) -> Picture:
    """Reads a layer of an EXR, all of its channels (default: the beauty).

    Raises `CumuloError` if the file or the layer cannot be read.
    """
    with tempfile.TemporaryDirectory(prefix="cumulo-") as folder:
        array = pathlib.Path(folder) / "layer.npy"
        made = convert(path, array, layer=layer, **options)
        values = np.load(array)
    if made.layer is None:
        raise CumuloError("invalid", "this is no picture", os.fspath(path), None, "read volumes with cumulo.arrays.read_volume")
    return Picture(values, tuple(made.layer.channels), made.layer.name)


def write_picture(path: Path, values: npt.ArrayLike, **options: Any) -> None:
    """Writes [row, column] or [row, column, channel] of grey, RGB or RGBA as a float EXR with R, G, B and A."""
    _through(path, values, options)


def _through(path: Path, values: npt.ArrayLike, options: dict[str, Any]) -> None:
    with tempfile.TemporaryDirectory(prefix="cumulo-") as folder:
        array = pathlib.Path(folder) / "array.npy"
        np.save(array, np.ascontiguousarray(values, dtype=np.float32))
        try:
            convert(array, path, **options)
        except CumuloError as error:
            if error.path != array:
                raise
            # The file is known here alone.
            raise CumuloError(error.code, error.what, os.fsdecode(path), error.part or "array", error.remedy) from None
