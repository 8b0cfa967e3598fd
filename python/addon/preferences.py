"""Preferences of the extension."""

import os
import shutil

import bpy


class Preferences(bpy.types.AddonPreferences):
    """Where the program is."""

    bl_idname = __package__

    program: bpy.props.StringProperty(
        name="Program", description="Path of the program cumulo; empty for the one on PATH", subtype="FILE_PATH"
    )

    def draw(self, context):
        """Shows the path, and whether the program is there."""
        self.layout.prop(self, "program")
        try:
            self.layout.label(text=f"Uses {program_path(context)}", icon="CHECKMARK")
        except FileNotFoundError as missing:
            self.layout.label(text=str(missing), icon="ERROR")


def program_path(context):
    """Path of the program: that of the preferences, else the one on PATH. Raises FileNotFoundError, which says what to do."""
    chosen = context.preferences.addons[__package__].preferences.program
    if chosen:
        path = bpy.path.abspath(chosen)
        if os.path.isfile(path) and os.access(path, os.X_OK):
            return path
        raise FileNotFoundError(f"{path} is no program; correct its path in the preferences of the extension Cumulo")
    found = shutil.which("cumulo")
    if found is None:
        raise FileNotFoundError(
            "No program cumulo on PATH; install it, or set its path in the preferences of the extension Cumulo"
        )
    return found
