"""From any scene of Blender to Cumulo: scene files, camera paths, and captures for reconstruction (needs `bpy`).

    from cumulo import bpy_scene
    capture = bpy_scene.capture("shots", views=24)           # pictures of the scene's volume, for `cumulo reconstruct`
    exported = bpy_scene.export("out", frames=range(1, 25))  # scene.json and transforms.json, for `cumulo render`
    thing = bpy_scene.load("found.vdb", like="Smoke")        # a reconstruction beside the original

What Cumulo would show as something else is refused, with the names of the object and the node, or left out on request.
"""

from .. import cycles  # noqa: F401  isort: skip  exposes the modules that Blender brings
from .export import Export, describe, export, export_steps, frames_of
from .motion import motion_arguments, motion_steps
from .refusal import Refused
from .results import load
from .shots import capture, count_volumes, shots

__all__ = [
    "Export",
    "Refused",
    "capture",
    "count_volumes",
    "describe",
    "export",
    "export_steps",
    "frames_of",
    "load",
    "motion_arguments",
    "motion_steps",
    "shots",
]
