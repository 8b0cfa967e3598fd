"""The panel of the extension as a picture, for the guide. It needs a Blender with a window, and a display:

    xvfb-run -s '-screen 0 860x760x24' blender --factory-startup --window-geometry 0 0 860 760 --python python/addon/screenshot.py -- PANEL.png

Debian's Blender is older than extensions, so that the add-on is registered from here; its operators are not run.
"""

import importlib.util
import pathlib
import sys
import types

import bpy

HERE = pathlib.Path(__file__).resolve().parent
NAME = "cumulo_panel"


def load():
    """The settings, operators and panel, without what reads scenes."""
    package = types.ModuleType(NAME)
    package.__path__ = [str(HERE)]
    sys.modules[NAME] = package
    # The panel draws buttons; what they do is not needed for that.
    for name in ("cumulo", "cumulo.bpy_scene"):
        sys.modules[name] = types.ModuleType(name)
    sys.modules["cumulo"].bpy_scene = sys.modules["cumulo.bpy_scene"]
    spec = importlib.util.spec_from_file_location(NAME, HERE / "__init__.py", submodule_search_locations=[str(HERE)])
    package = importlib.util.module_from_spec(spec)
    sys.modules[NAME] = package
    spec.loader.exec_module(package)
    return package


def arrange():
    """A smoke in the view, the sidebar open, and no other tab in it."""
    bpy.context.preferences.view.show_splash = False
    # A plain background makes a small file.
    bpy.context.preferences.themes[0].view_3d.space.gradients.background_type = "SINGLE_COLOR"
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)
    volume = bpy.data.volumes.new("Smoke")
    volume.filepath = str(HERE.parents[1] / "fixtures" / "plume.vdb")
    volume.display.density = 20.0
    thing = bpy.data.objects.new("Smoke", volume)
    bpy.context.collection.objects.link(thing)
    bpy.context.scene.cumulo.volume = thing
    for panel in bpy.types.Panel.__subclasses__():
        place = (getattr(panel, "bl_space_type", ""), getattr(panel, "bl_region_type", ""))
        if place == ("VIEW_3D", "UI") and getattr(panel, "bl_category", "") != "Cumulo" and panel.is_registered:
            bpy.utils.unregister_class(panel)
    for area in bpy.context.screen.areas:
        if area.type == "VIEW_3D":
            space = area.spaces.active
            space.show_region_ui, space.show_region_toolbar, space.show_gizmo = True, False, False
            space.overlay.show_text = space.overlay.show_cursor = False
            space.region_3d.view_location, space.region_3d.view_distance = (1.8, 0.2, 1.0), 5.5


def capture(target):
    """Writes the picture of the 3D view."""
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    with bpy.context.temp_override(window=window, area=area):
        bpy.ops.screen.screenshot_area(filepath=target)
    bpy.ops.wm.quit_blender()


def main():
    """Waits before the picture, for the sidebar opens at the first drawing."""
    load().register()
    arrange()
    bpy.app.timers.register(lambda: capture(sys.argv[sys.argv.index("--") + 1]), first_interval=3.0)


main()
