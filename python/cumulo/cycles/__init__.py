"""Volumes rendered by Blender's Cycles: settings, materials, lights, and the scene that they stand in (needs `bpy`)."""

import bpy

# Blender before 4.4 has its modules in the open.
if hasattr(bpy.utils, "expose_bundled_modules"):
    bpy.utils.expose_bundled_modules()

from .lights import Rectangle, Sphere, Sun  # noqa: E402  needs what was just exposed
from .settings import Settings  # noqa: E402
from .stage import Stage  # noqa: E402

__all__ = ["Rectangle", "Settings", "Sphere", "Stage", "Sun"]
