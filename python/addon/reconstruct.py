"""Operator: Reconstruct."""

import bpy
from cumulo import bpy_scene

from .job import Job
from .settings import folder_of
from .work import run


class Reconstruct(Job, bpy.types.Operator):
    """Find the densities that a capture shows, write them as a VDB and load it"""

    bl_idname = "cumulo.reconstruct"
    bl_label = "Reconstruct"
    # The result that it loads can be undone.
    bl_options = {"UNDO"}

    capture: bpy.props.StringProperty(
        name="Capture",
        description="Folder or transforms.json of the views; empty for 'views' in the panel's folder",
        subtype="FILE_PATH",
    )
    output: bpy.props.StringProperty(
        name="Output",
        description="VDB to write; empty for reconstruction.vdb in the panel's folder",
        subtype="FILE_PATH",
    )
    resolution: bpy.props.IntProperty(
        name="Resolution", description="Voxels along the longest edge; 0 for the capture's own", min=0, max=4096
    )
    like: bpy.props.StringProperty(
        name="Like", description="Object whose medium the result gets; empty for a grey one that absorbs"
    )
    load: bpy.props.BoolProperty(name="Load", description="Load the result into the scene", default=True)

    def steps(self, context):
        """Reconstructs, and loads what was found."""
        # By name, for the reconstruction takes a while, in which an undo makes all data anew.
        name, panel = context.scene.name, context.scene.cumulo.folder
        capture = folder_of(self.capture) if self.capture else folder_of(panel) / "views"
        output = folder_of(self.output) if self.output else folder_of(panel) / "reconstruction.vdb"
        words = ["reconstruct", "density", capture, "-o", output]
        if self.resolution:
            words += ["--resolution", self.resolution]
        report = yield from run(words)
        if self.load:
            if name not in bpy.data.scenes:
                raise ValueError(f"{output} is written, but the scene {name!r} is gone; load it by Load Result")
            bpy_scene.load(output, bpy.data.scenes[name], self.like or None, capture)
        self.report({"INFO"}, f"{output}: {report['iterations']} iterations")
