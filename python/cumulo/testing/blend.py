"""Renders a .blend as a reference (needs `bpy`)."""

from __future__ import annotations

import pathlib

import bpy


def render(path: pathlib.Path, out: pathlib.Path, seed: int, frame: int | None, camera: str | None,
           size: tuple[int, int] | None, samples: int) -> list[str]:  # fmt: skip
    """Renders the scene of the file into an EXR and returns the files that it links.

    Raises ValueError if the scene is not Cycles', or has no such camera.
    """
    bpy.ops.wm.open_mainfile(filepath=str(path.absolute()))
    scene = bpy.context.scene
    if scene.render.engine != "CYCLES":
        raise ValueError(f"{path}: the scene renders with {scene.render.engine}; references are Cycles' pictures")
    if camera is not None:
        if camera not in scene.objects or scene.objects[camera].type != "CAMERA":
            names = [thing.name for thing in scene.objects if thing.type == "CAMERA"]
            raise ValueError(f"{path}: no camera {camera!r}; the scene has {', '.join(names) or 'none'}")
        scene.camera = scene.objects[camera]
    if scene.camera is None:
        raise ValueError(f"{path}: the scene has no camera")
    if frame is not None:
        scene.frame_set(frame)
    if size is not None:
        scene.render.resolution_x, scene.render.resolution_y = size
        scene.render.resolution_percentage = 100
    _unbiased(scene, seed, samples)
    settings = scene.render.image_settings
    settings.media_type = "IMAGE"
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGBA", "32"
    scene.render.filepath = str(out.absolute())
    bpy.ops.render.render(write_still=True)
    return sorted(set(bpy.utils.blend_paths(absolute=True, packed=False)))


def _unbiased(scene: bpy.types.Scene, seed: int, samples: int) -> None:
    """Means over independent samples by pixel: no denoising, no clamping, nothing that ties neighbours."""
    cycles = scene.cycles
    cycles.seed, cycles.samples, cycles.use_animated_seed = seed, samples, False
    # Neither a view layer nor a clock may say how many.
    cycles.use_layer_samples, cycles.time_limit, cycles.use_sample_subset = "IGNORE", 0.0, False
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.sampling_pattern = "TABULATED_SOBOL"
    cycles.pixel_filter_type = "BOX"
    scene.view_settings.view_transform = "Raw"
    scene.render.use_compositing = scene.render.use_sequencer = False
    scene.render.use_file_extension = False
