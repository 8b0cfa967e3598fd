"""Figures of reports and arrays with matplotlib (`pip install cumulo[plots]`).

Functions return a `matplotlib.figure.Figure` that no window manager knows: `figure.savefig("a.png")`, or let a
notebook show it.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from . import arrays, results
from .options import Path


class Drawing(Figure):
    """A figure that notebooks show without any magic."""

    def _repr_png_(self) -> bytes:
        png = io.BytesIO()
        self.savefig(png, format="png")
        return png.getvalue()


def _figure(width: float, height: float) -> Figure:
    return Drawing(figsize=(width, height), layout="constrained")


def display(linear: npt.ArrayLike, exposure: float = 1.0) -> npt.NDArray[np.float64]:
    """Scene-linear [row, column, 3 or 4] as sRGB from 0 to 1, [row, column, 3]."""
    v = np.clip(np.asarray(linear, np.float64)[..., :3] * exposure, 0, 1)
    return np.asarray(np.where(v < 0.0031308, 12.92 * v, 1.055 * np.maximum(v, 1e-9) ** (1 / 2.4) - 0.055))


def convergence(found: results.Reconstruction | results.TransferFunction) -> Figure:
    """Loss (of transfer functions RMS), and PSNR of the views held out where there are any, by iteration; a line for each level of resolution."""
    figure = _figure(6, 3.5)
    axes = figure.subplots()
    levels = sorted({step.level or 0 for step in found.history})
    for level in levels:
        steps = [(k, step) for k, step in enumerate(found.history, 1) if (step.level or 0) == level]
        values = [np.nan if step.objective is None else step.objective for _, step in steps]
        axes.plot([k for k, _ in steps], values, marker=".", label=f"level {level}")
    axes.set(xlabel="iteration", ylabel="loss" if isinstance(found, results.Reconstruction) else "RMS")
    if all((step.objective or 0) > 0 for step in found.history):
        axes.set_yscale("log")
    held_out = [(k, step.held_out_psnr_db) for k, step in enumerate(found.history, 1) if step.held_out_psnr_db is not None]
    if held_out:
        right = axes.twinx()
        right.plot(*zip(*held_out), color="black", linestyle="--", label="held-out views")
        right.set_ylabel("PSNR in dB")
    if len(levels) > 1:
        axes.legend()
    return figure


def views(given: Sequence[Path | npt.ArrayLike], made: Sequence[Path | npt.ArrayLike], *, exposure: float = 1.0,
          labels: tuple[str, str] = ("given", "made")) -> Figure:  # fmt: skip
    """Pictures next to their originals, and the absolute differences of their colors below; EXRs or arrays
    [row, column, channel]. Raises ValueError for other numbers on the two sides."""
    if len(given) != len(made) or not given:
        raise ValueError(f"{len(given)} given and {len(made)} made pictures; as many of each are expected, at least one")
    pairs = [tuple(_picture(p) for p in pair) for pair in zip(given, made)]
    figure = _figure(2.2 * len(pairs) + 0.8, 6.6)
    grid = figure.subplots(3, len(pairs), squeeze=False)
    differences = [np.abs(a[..., :3] - b[..., :3]).max(axis=-1) for a, b in pairs]
    largest = max(float(d.max()) for d in differences) or 1.0
    image: Any = None
    for column, (pair, difference) in enumerate(zip(pairs, differences)):
        for row in range(2):
            grid[row][column].imshow(display(pair[row], exposure))
        image = grid[2][column].imshow(difference, vmin=0, vmax=largest, cmap="inferno")
    for axes in grid.ravel():
        axes.set(xticks=[], yticks=[])
    for row, label in enumerate((*labels, "difference")):
        grid[row][0].set_ylabel(label)
    figure.colorbar(image, ax=grid[2].tolist(), shrink=0.8)
    return figure


def _picture(source: Any) -> npt.NDArray[np.float64]:
    values = source if isinstance(source, np.ndarray) else arrays.read_picture(source).values
    return np.asarray(values, np.float64)


def histogram(volume: arrays.Volume, bins: int = 64) -> Figure:
    """Number of voxels by value, of those that differ from the background, on a logarithmic axis."""
    figure = _figure(6, 3)
    axes = figure.subplots()
    values = volume.values[volume.values != np.float32(volume.background[0])]
    axes.hist(values.ravel(), bins=bins, log=True, color="#4477aa")
    axes.set(xlabel=volume.name, ylabel="voxels")
    return figure


def slices(volume: arrays.Volume, position: Sequence[float] = (0.5, 0.5, 0.5), cmap: str = "viridis") -> Figure:
    """Slices of a scalar volume across x, y and z, at these shares of its extents, with world coordinates along the
    axes (of a transform that turns nothing; else indices)."""
    if volume.values.ndim != 3:
        raise ValueError(f"slices are of scalars, [x, y, z]; the array has shape {volume.values.shape}")
    figure = _figure(10, 3.4)
    linear = volume.transform[:3, :3]
    upright = np.array_equal(linear, np.diag(np.diag(linear)))
    low, high = float(volume.values.min()), float(volume.values.max())
    image: Any = None
    for axis, axes in enumerate(figure.subplots(1, 3)):
        index = min(int(position[axis] * volume.values.shape[axis]), volume.values.shape[axis] - 1)
        across, up = (a for a in range(3) if a != axis)
        plane = np.take(volume.values, index, axis)
        edges = [np.array([-0.5, volume.values.shape[a] - 0.5]) for a in (across, up)]
        if upright:
            edges = [e * linear[a, a] + volume.transform[a, 3] for e, a in zip(edges, (across, up))]
        extent = (*edges[0].tolist(), *edges[1].tolist())
        image = axes.imshow(plane.T, origin="lower", extent=extent, vmin=low, vmax=high, cmap=cmap)
        axes.set(xlabel="xyz"[across], ylabel="xyz"[up], title=f"{'xyz'[axis]} = voxel {index}")
    figure.colorbar(image, ax=figure.axes, shrink=0.8, label=volume.name)
    return figure
