"""The panel in the sidebar of the 3D view."""

import bpy

from .job import Job


class Panel(bpy.types.Panel):
    """Buttons of the operators, and their settings."""

    bl_idname = "VIEW3D_PT_cumulo"
    bl_label = "Cumulo"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Cumulo"

    def draw(self, context):
        """Draws three boxes: of the scene, of reconstruction, and of denoising."""
        settings, layout = context.scene.cumulo, self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(settings, "folder")
        self._scene(layout.box(), settings)
        self._reconstruction(layout.box(), settings)
        box = layout.box()
        box.label(text="Sequence", icon="RENDER_ANIMATION")
        box.operator("cumulo.denoise")
        if Job.active is not None:
            layout.label(text="Esc cancels", icon="CANCEL")

    def _scene(self, box, settings):
        box.label(text="Scene", icon="SCENE_DATA")
        box.prop(settings, "samples")
        box.prop(settings, "animation")
        box.prop(settings, "ignore")
        button = box.operator("cumulo.export_scene")
        button.animation, button.ignore = settings.animation, settings.ignore
        button = box.operator("cumulo.render")
        button.animation, button.samples, button.ignore = settings.animation, settings.samples, settings.ignore

    def _reconstruction(self, box, settings):
        box.label(text="Reconstruction", icon="OUTLINER_OB_VOLUME")
        for name in ("volume", "views", "size", "view_samples", "resolution"):
            box.prop(settings, name)
        volume = settings.volume.name if settings.volume else ""
        button = box.operator("cumulo.render_views")
        button.volume, button.views, button.size, button.samples = (
            volume,
            settings.views,
            settings.size,
            settings.view_samples,
        )
        button = box.operator("cumulo.reconstruct")
        button.resolution, button.like = settings.resolution, volume
        box.operator("cumulo.load_result").like = volume
