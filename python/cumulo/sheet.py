"""Contact sheets: pictures side by side in a PNG.

    python -m cumulo.sheet CAPTURE OUT.png [--columns 6] [--shrink 2] [--exposure E]

CAPTURE is a folder of EXR pictures. Needs the `OpenImageIO` module, which Blender brings.
"""

import argparse
import pathlib

import numpy as np
import OpenImageIO as oiio

from .exr import read_exr


def blocks(picture, edge):
    """Means of the colors over blocks of edge² pixels, [height, width, 3] from [height, width, 4]."""
    height, width = (n // edge * edge for n in picture.shape[:2])
    return picture[:height, :width, :3].reshape(height // edge, edge, width // edge, edge, 3).mean((1, 3))


def srgb(linear, exposure):
    """Scene-linear colors times the exposure as 8-bit sRGB, clipped."""
    linear = np.clip(linear * exposure, 0, 1)
    return (np.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055) * 255 + 0.5).astype("u1")


def write_png(path, pixels):
    """Writes [height, width, 3] of 8 bits."""
    pixels = np.ascontiguousarray(pixels)
    out = oiio.ImageOutput.create(str(path))
    out.open(str(path), oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, oiio.UINT8))
    out.write_image(pixels)
    out.close()


def sheet(pictures, columns, shrink, exposure=None):
    """Pictures in rows, as 8-bit sRGB; without an exposure, the 99.7th percentile becomes 0.8."""
    small = [blocks(picture, shrink) for picture in pictures]
    exposure = exposure or 0.8 / np.percentile(np.stack(small), 99.7)
    tiles = [srgb(picture, exposure) for picture in small]
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % columns)
    return np.vstack([np.hstack(tiles[i : i + columns]) for i in range(0, len(tiles), columns)])


def main():
    """Reads a folder and writes the sheet."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("capture", type=pathlib.Path)
    p.add_argument("out", type=pathlib.Path)
    p.add_argument("--columns", type=int, default=6)
    p.add_argument("--shrink", type=int, default=2)
    p.add_argument("--exposure", type=float)
    a = p.parse_args()
    pictures = [read_exr(path) for path in sorted(a.capture.glob("*.exr"))]
    write_png(a.out, sheet(pictures, a.columns, a.shrink, a.exposure))


if __name__ == "__main__":
    main()
