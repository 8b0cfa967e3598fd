"""PNGs of pictures and differences, without a library."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


def png(pixels: npt.NDArray[np.uint8]) -> bytes:
    """A PNG of [row, column, 3] of 8 bits."""
    height, width, _ = pixels.shape
    rows = np.hstack([np.zeros((height, 1), np.uint8), pixels.reshape(height, 3 * width)])

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows.tobytes(), 9)) + chunk(b"IEND", b"")


def display(linear: npt.ArrayLike, exposure: float) -> npt.NDArray[np.uint8]:
    """Scene-linear colors [row, column, 3 or 4] times the exposure as 8-bit sRGB, clipped; NaN is magenta."""
    colors = np.asarray(linear, np.float64)[..., :3]
    bad = ~np.isfinite(colors).all(axis=-1)
    v = np.clip(np.nan_to_num(colors * exposure), 0, 1)
    made = (np.where(v < 0.0031308, 12.92 * v, 1.055 * np.maximum(v, 1e-9) ** (1 / 2.4) - 0.055) * 255 + 0.5).astype(np.uint8)
    made[bad] = (255, 0, 255)
    return np.ascontiguousarray(made)


def exposure(linear: npt.ArrayLike) -> float:
    """Exposure at which the 99.5th percentile of the colors becomes 0.9; 1 for a black picture."""
    colors = np.asarray(linear, np.float64)[..., :3]
    finite = colors[np.isfinite(colors)]
    bright = float(np.percentile(finite, 99.5)) if finite.size else 0.0
    return 0.9 / bright if bright > 0 else 1.0


def signed(difference: Floats, scale: float) -> npt.NDArray[np.uint8]:
    """Differences [row, column] as red where above 0 and blue where below, white at 0, full at `scale`; NaN is black."""
    share = np.clip(np.nan_to_num(difference) / scale if scale > 0 else 0 * difference, -1, 1)
    strength = np.abs(share)[..., None]
    full = np.where(share[..., None] > 0, (178.0, 24.0, 43.0), (33.0, 102.0, 172.0))
    made = (255 * (1 - strength) + full * strength + 0.5).astype(np.uint8)
    made[~np.isfinite(difference)] = 0
    return np.ascontiguousarray(made)


def blocks(values: Floats, edge: int) -> Floats:
    """Means over blocks of edge x edge pixels, each at the size of its block; blocks at the border may be smaller."""
    made = np.empty_like(values)
    for y in range(0, values.shape[0], edge):
        for x in range(0, values.shape[1], edge):
            part = (slice(y, y + edge), slice(x, x + edge))
            made[part] = values[part].mean()
    return made


def scale_of(difference: Floats) -> float:
    """Scale at which all but the largest two percent of the differences are told apart."""
    finite = np.abs(difference[np.isfinite(difference)])
    return float(np.percentile(finite, 98)) or float(finite.max()) if finite.size else 0.0
