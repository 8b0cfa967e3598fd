"""Operator: Export scene."""

import bpy

from .cumulo import bpy_scene
from .settings import folder_of


def frames_to_show(scene, animation):
    """The numbers of the scene's animation, or of its present frame."""
    return bpy_scene.frames_of(scene) if animation else (scene.frame_current,)


class ExportScene(bpy.types.Operator):
    """Write the scene's volumes, lights, world and camera as a scene file and a camera path of Cumulo"""

    bl_idname = "cumulo.export_scene"
    bl_label = "Export Scene"

    folder: bpy.props.StringProperty(
        name="Folder", description="Folder to write into; empty for the panel's", subtype="DIR_PATH"
    )
    animation: bpy.props.BoolProperty(
        name="Animation", description="All frames of the scene, in place of the present one"
    )

    def execute(self, context):
        """Exports, and says how the program renders what was written."""
        try:
            folder = folder_of(self.folder or context.scene.cumulo.folder)
            exported = bpy_scene.export(folder, context.scene, frames_to_show(context.scene, self.animation))
        except (ValueError, OSError, RuntimeError) as fault:
            self.report({"ERROR"}, str(fault))
            return {"CANCELLED"}
        self.report({"INFO"}, f"cumulo {' '.join(exported.arguments(folder / 'render'))}")
        return {"FINISHED"}
