"""Reads and writes EXR pictures (needs the `OpenImageIO` module, which Blender brings)."""

from __future__ import annotations

import json
import os
import pathlib
import tempfile
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio

from .options import Path


def read_exr(path: Path) -> npt.NDArray[np.float32]:
    """Red, green, blue and alpha of a single-part EXR, [height, width, 4] f32; of several layers the
    one named Combined."""
    source = oiio.ImageInput.open(str(path))
    if source is None:
        raise ValueError(f"{path}: {oiio.geterror()}")
    spec = source.spec()
    pixels = source.read_image(0, 0, 0, spec.nchannels, oiio.FLOAT)
    fault = source.geterror()
    source.close()
    if pixels is None:
        raise ValueError(f"{path}: it cannot be read: {fault or 'it is damaged'}")
    by_name = {name.removeprefix("ViewLayer.").removeprefix("Combined."): i for i, name in enumerate(spec.channelnames)}
    missing = [c for c in "RGBA" if c not in by_name]
    if missing:
        raise ValueError(f"{path}: no channel {', '.join(missing)} among {', '.join(spec.channelnames)}")
    return np.ascontiguousarray(pixels[..., [by_name[c] for c in "RGBA"]], dtype=np.float32)


def write_exr(path: Path, pixels: npt.NDArray[np.float32], software: str, attributes: Mapping[str, Any]) -> None:
    """Writes [height, width, 4] f32 as one float part with channels A, B, G, R, whole or not at all;
    `attributes` go into its header as `cumulo:KEY`, in JSON."""
    path = pathlib.Path(path)
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 4, oiio.FLOAT)
    spec.channelnames = ("R", "G", "B", "A")
    spec.attribute("compression", "zip")
    spec.attribute("Software", software)
    for key, value in attributes.items():
        spec.attribute(f"cumulo:{key}", json.dumps(value))
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".writing-") as folder:
        draft = pathlib.Path(folder) / path.name
        out = oiio.ImageOutput.create(str(draft))
        if out is None:
            raise OSError(f"{path}: cannot write the picture: {oiio.geterror()}")
        # `and` keeps the first failure's message.
        done = out.open(str(draft), spec) and out.write_image(np.ascontiguousarray(pixels)) and out.close()
        if not done:
            raise OSError(f"{path}: cannot write the picture: {out.geterror()}")
        os.replace(draft, path)
