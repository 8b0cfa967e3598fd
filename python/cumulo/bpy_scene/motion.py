"""The volume of an animation, as `cumulo motion` takes it."""

import pathlib

import numpy as np

from .. import padding
from ..cycles.views import finish
from .export import frame_kept
from .shots import chosen
from .volumes import vdb_of, volume_entry


def motion_arguments(folder, scene, frames):
    """Arguments of `cumulo motion` that name the only volume of a scene, its grid and its density scale.

    A VDB that is the same in all frames and stands where its file says is named itself; else copies of its densities that
    are moved to the world are written into `folder`, numbered by the frames. Raises Refused as `export` does.
    """
    return finish(motion_steps(folder, scene, frames))


def motion_steps(folder, scene, frames):
    """What `motion_arguments` does, frame by frame: a generator of (frames done, frames) that returns the arguments."""
    folder = pathlib.Path(folder)
    shown = []
    with frame_kept(scene):
        for frame in frames:
            scene.frame_set(frame)
            placed = chosen(scene)
            shown.append(
                (vdb_of(placed), placed.matrix, volume_entry(placed, folder, scene.render.fps / scene.render.fps_base))
            )
            yield len(shown), len(frames)
    path, matrix, entry = shown[0]
    same = all(other == path and np.array_equal(at, matrix) for other, at, _ in shown)
    options = ["--grid", entry["grid"], "--density-scale", str(entry["medium"]["density_scale"])]
    if same and np.array_equal(matrix, np.eye(4)):
        if velocity := entry.get("velocity"):
            options += ["--velocity", velocity["grid"], "--fps", str(velocity["fps"])]
        return [str(path), *options]
    folder.mkdir(parents=True, exist_ok=True)
    if same:
        padding.moved_copy(path, entry["grid"], matrix, folder / "volume.vdb")
        return [str(folder / "volume.vdb"), *options]
    for done, (frame, (path, matrix, entry)) in enumerate(zip(frames, shown)):
        padding.moved_copy(path, entry["grid"], matrix, folder / f"volume.{frame:04}.vdb")
        yield done + 1, len(frames)
    return [str(folder / "volume.####.vdb"), *options]
