"""Operator: Render with Cumulo."""

import bpy

from .export import export_of
from .job import Job
from .settings import IGNORE, IGNORING, folder_of
from .work import run

# Name of the image that shows the result, and the property by which it is known, for others may have its name.
IMAGE = "Cumulo"
MARK = "cumulo_result"


class Render(Job, bpy.types.Operator):
    """Render the scene's volumes with Cumulo, and show the result as an image"""

    bl_idname = "cumulo.render"
    bl_label = "Render with Cumulo"

    folder: bpy.props.StringProperty(
        name="Folder", description="Folder of the pictures; empty for 'render' in the panel's", subtype="DIR_PATH"
    )
    animation: bpy.props.BoolProperty(
        name="Animation", description="All frames of the scene, in place of the present one"
    )
    samples: bpy.props.IntProperty(name="Samples", description="Paths per pixel", default=64, min=1)
    ignore: bpy.props.BoolProperty(name=IGNORE, description=IGNORING)

    def steps(self, context):
        """Exports the scene, renders it, and loads the pictures."""
        scene = context.scene
        folder = folder_of(self.folder) if self.folder else folder_of(scene.cumulo.folder) / "render"
        exported = yield from export_of(self, scene, folder / "scene")
        words = [*exported.arguments(folder, self.samples), "--overwrite"]
        if self.animation:
            # What Denoise Sequence follows.
            words += ["--aov", "motion"]
        yield from run(words)
        image = show(folder / f"frame.{exported.frames[0]:04}.exr", len(exported.frames))
        self.report({"INFO"}, f"{pictures_in(folder, len(exported.frames))}, and the image {image.name}")


def pictures_in(folder, count):
    """How many pictures are in a folder, in words."""
    return f"{count} picture is in {folder}" if count == 1 else f"{count} pictures are in {folder}"


def show(path, frames):
    """Makes the image `IMAGE` of a picture, or of a sequence that begins with it; the one of an earlier result is reused."""
    image = next((each for each in bpy.data.images if each.get(MARK) and each.library is None), None)
    if image is None:
        image = bpy.data.images.load(str(path))
        image.name, image[MARK] = IMAGE, True
    image.filepath = str(path)
    image.source = "SEQUENCE" if frames > 1 else "FILE"
    image.reload()
    return image
