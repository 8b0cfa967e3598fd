"""Operator: Load Result."""

import bpy
from cumulo import bpy_scene

from .settings import folder_of


class LoadResult(bpy.types.Operator):
    """Load a VDB where it belongs, with a Principled Volume"""

    bl_idname = "cumulo.load_result"
    bl_label = "Load Result"
    bl_options = {"REGISTER", "UNDO"}

    filepath: bpy.props.StringProperty(name="File", description="VDB to load", subtype="FILE_PATH")
    filter_glob: bpy.props.StringProperty(default="*.vdb", options={"HIDDEN"})
    like: bpy.props.StringProperty(name="Like", description="Object whose medium it gets; empty for the capture's")
    capture: bpy.props.StringProperty(
        name="Capture",
        description="Capture that it was reconstructed from; its density scale is set",
        subtype="FILE_PATH",
    )

    def execute(self, context):
        """Loads the VDB."""
        try:
            capture = folder_of(self.capture) if self.capture else None
            thing = bpy_scene.load(folder_of(self.filepath), context.scene, self.like or None, capture)
        except (ValueError, OSError, RuntimeError) as fault:
            self.report({"ERROR"}, str(fault))
            return {"CANCELLED"}
        self.report({"INFO"}, f"{self.filepath} is the object {thing.name}")
        return {"FINISHED"}

    def invoke(self, context, event):
        """Asks for the file."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}
