"""Operator: Denoise Sequence."""

import bpy
from cumulo import bpy_scene

from .job import Job, labelled
from .render import pictures_in, show
from .settings import folder_of
from .work import run


class Denoise(Job, bpy.types.Operator):
    """Take the noise out of the pictures of an animation, along the motion of the volume"""

    bl_idname = "cumulo.denoise"
    bl_label = "Denoise Sequence"

    pictures: bpy.props.StringProperty(
        name="Pictures",
        description="Noisy EXRs, frame.####.exr; empty for those of Render with Cumulo in the panel's folder",
        subtype="FILE_PATH",
    )
    folder: bpy.props.StringProperty(
        name="Folder", description="Folder of the result; empty for 'denoised' in the panel's", subtype="DIR_PATH"
    )

    def steps(self, context):
        """Computes the motion of the only volume, and denoises along it; of several volumes pictures carry their own."""
        scene = context.scene
        panel = scene.cumulo.folder
        pictures = folder_of(self.pictures) if self.pictures else folder_of(panel) / "render" / "frame.####.exr"
        folder = folder_of(self.folder) if self.folder else folder_of(panel) / "denoised"
        frames = bpy_scene.frames_of(scene)
        words = ["denoise", pictures, "-o", folder / "frame.####.exr", "--overwrite"]
        exported = yield from labelled("export", bpy_scene.export_steps(folder / "scene", scene, frames))
        if bpy_scene.count_volumes(scene) == 1:
            volume = yield from labelled("volume", bpy_scene.motion_steps(folder / "scene", scene, frames))
            motion = folder / "motion" / "frame.####.exr"
            yield from run(["motion", *volume, "--cameras", exported.cameras, "-o", motion, "--overwrite"])
            words += ["--motion", f"files:{motion}"]
        before = stamps(folder)
        report = yield from run(words)
        # An earlier run may have left pictures of other frames.
        written = sorted(path for path, stamp in stamps(folder).items() if before.get(path) != stamp)
        show(written[0], len(written))
        self.report({"INFO"}, pictures_in(folder, report["denoised"]))


def stamps(folder):
    """The pictures in a folder, each with what tells whether it was written since."""
    found = {path: path.stat() for path in folder.glob("frame.*.exr")}
    return {path: (stat.st_ino, stat.st_mtime_ns, stat.st_size) for path, stat in found.items()}
