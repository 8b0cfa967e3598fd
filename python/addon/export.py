"""Operator: Export scene."""

import bpy
from cumulo import bpy_scene

from .job import Job, labelled
from .settings import IGNORE, IGNORING, folder_of


def frames_to_show(scene, animation):
    """The numbers of the scene's animation, or of its present frame."""
    return bpy_scene.frames_of(scene) if animation else (scene.frame_current,)


def export_of(operator, scene, folder):
    """Steps that export a scene as the properties of an operator say, and report what is left out; they return the Export."""
    frames = frames_to_show(scene, operator.animation)
    try:
        exported = yield from labelled("export", bpy_scene.export_steps(folder, scene, frames, operator.ignore))
    except bpy_scene.Refused as refused:
        optional = sum(bool(complaint.without) for complaint in refused.complaints)
        if operator.ignore or not optional:
            raise
        raise ValueError(f"{refused}\n{IGNORE} leaves out {optional} of these {len(refused.complaints)}") from refused
    for each in exported.left_out:
        operator.report({"WARNING"}, f"Left out: {each}")
    return exported


class ExportScene(Job, bpy.types.Operator):
    """Write the scene's volumes, lights, world and camera as a scene file and a camera path of Cumulo"""

    bl_idname = "cumulo.export_scene"
    bl_label = "Export Scene"

    folder: bpy.props.StringProperty(
        name="Folder", description="Folder to write into; empty for the panel's", subtype="DIR_PATH"
    )
    animation: bpy.props.BoolProperty(
        name="Animation", description="All frames of the scene, in place of the present one"
    )
    ignore: bpy.props.BoolProperty(name=IGNORE, description=IGNORING)

    def steps(self, context):
        """Exports one frame a step, and gives the command that renders what was written."""
        scene = context.scene
        folder = folder_of(self.folder or scene.cumulo.folder)
        exported = yield from export_of(self, scene, folder)
        self.report({"INFO"}, exported.command(folder / "render"))
