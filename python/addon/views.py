"""Operator: Render Views for Reconstruction."""

import bpy
from cumulo import bpy_scene

from .job import Job, labelled
from .settings import folder_of


class RenderViews(Job, bpy.types.Operator):
    """Place cameras around the volume and render what it absorbs, as a capture for Reconstruct"""

    bl_idname = "cumulo.render_views"
    bl_label = "Render Views for Reconstruction"

    folder: bpy.props.StringProperty(
        name="Folder", description="Folder of the capture; empty for 'views' in the panel's", subtype="DIR_PATH"
    )
    volume: bpy.props.StringProperty(name="Volume", description="Name of the object; empty for the only volume")
    views: bpy.props.IntProperty(name="Views", description="Cameras around the volume", default=32, min=1, max=1000)
    size: bpy.props.IntProperty(name="Size", description="Width and height in pixels", default=128, min=8, max=8192)
    samples: bpy.props.IntProperty(name="Samples", description="Samples per pixel", default=32, min=1)

    def steps(self, context):
        """Renders one view a step."""
        folder = folder_of(self.folder) if self.folder else folder_of(context.scene.cumulo.folder) / "views"
        shots = bpy_scene.shots(
            folder,
            context.scene,
            self.volume or None,
            views=self.views,
            size=(self.size, self.size),
            samples=self.samples,
        )
        yield 0, self.views, "views"
        yield from labelled("views", shots)
        self.report({"INFO"}, f"{self.views} views are in {folder}")
