"""Captures that Cycles renders, view by view."""

import dataclasses
import os
import pathlib
import tempfile

import bpy

from ..capture import Capture
from ..exr import write_exr


def capture_steps(stage, cameras, folder, lattice):
    """Renders one view a camera into `folder` and writes its `transforms.json`; a generator of (views done, views) that
    returns the Capture.

    Each view has a seed of its own (settings.seed + its number), so that noise does not repeat. `lattice` is the
    index-to-world matrix of the volume. Until all views are rendered a capture that is there already stays as it is.
    """
    folder, settings = pathlib.Path(folder), stage.settings
    folder.mkdir(parents=True, exist_ok=True)
    software = f"Blender {bpy.app.version_string} Cycles"
    frames = []
    with tempfile.TemporaryDirectory(dir=folder, prefix=".rendering-") as drafts:
        for number, camera in enumerate(cameras):
            picture = folder / f"view_{number:03}.exr"
            pixels = stage.picture(camera, settings.seed + number)
            attributes = dataclasses.asdict(settings) | {"seed": settings.seed + number}
            write_exr(pathlib.Path(drafts) / picture.name, pixels, software, attributes)
            # Other keys of the frame are about the picture that it had.
            frames.append((dataclasses.replace(camera, extra={}), picture))
            yield number + 1, len(cameras)
        for _, picture in frames:
            os.replace(pathlib.Path(drafts) / picture.name, picture)
    capture = Capture(
        frames,
        model=settings.model,
        background=settings.background,
        pixel_filter=settings.pixel_filter,
        near=settings.near,
        density_scale=settings.density_scale,
        emission=settings.emission,
        lattice=lattice,
    )
    capture.write(folder / "transforms.json")
    return capture


def capture_line(folder, capture):
    """One line about a capture that was written into a folder."""
    count = len(capture.frames)
    return f"{pathlib.Path(folder) / 'transforms.json'}: {count} view{'s' * (count != 1)}, density scale {capture.density_scale:g}"


def finish(steps, progress=None):
    """Runs a generator of (done, of) to its end, and gives what it returns. `progress` is called with each pair."""
    while True:
        try:
            done, of = next(steps)
        except StopIteration as end:
            return end.value
        if progress:
            progress(done, of)
