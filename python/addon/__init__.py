"""Blender's extension for Cumulo: volumes exported, rendered, reconstructed and denoised in Blender's process."""

import bpy

from . import denoise, export, job, load, panel, reconstruct, render, settings, views

CLASSES = (
    settings.Settings,
    export.ExportScene,
    views.RenderViews,
    reconstruct.Reconstruct,
    render.Render,
    denoise.Denoise,
    load.LoadResult,
    panel.Panel,
)


def register():
    """Called by Blender when the extension is switched on."""
    for each in CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Scene.cumulo = bpy.props.PointerProperty(type=settings.Settings)


def unregister():
    """Called by Blender when the extension is switched off."""
    try:
        # Blender forgets an operator that runs, and leaves its work and its progress to this.
        job.Job.stop(bpy.context)
    finally:
        del bpy.types.Scene.cumulo
        for each in reversed(CLASSES):
            bpy.utils.unregister_class(each)
