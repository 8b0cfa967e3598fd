"""Captures of a scene's volume for reconstruction."""

import bpy

from .. import padding
from ..capture import sphere_cameras
from ..cycles import Settings, Stage
from ..cycles.stage import scene_beside
from ..cycles.views import capture_steps, finish
from .refusal import named, refused
from .visible import placed_objects
from .volumes import lattice_of, vdb_of, volume_entry


def capture(folder, scene=None, volume=None, progress=None, **options):
    """Renders views around the volume of a scene with Cycles, and writes them with `transforms.json` into `folder`.

        from cumulo import bpy_scene
        capture = bpy_scene.capture("shots", views=24, size=(128, 128))

    `scene` is the present one unless given, `volume` the name of the object, which is needed where several volumes are
    rendered. `views` and `size` say how many cameras stand on a sphere around the volume, and the pixels of each, `samples`
    how many samples a pixel gets from which `seed`; `cameras` are other cameras.

    The pictures show the extinction alone, by absorption before white, for that is what a reconstruction of densities
    explains: of the scene they hold the volume at the present frame, with its transform and the density scale of its
    material, and neither its albedo, its emission nor any light. The scene itself stays as it is. Returns the Capture, whose
    density scale and lattice are the volume's. Raises Refused where the medium is not one that Cumulo knows, or its
    extinction has a color.
    """
    return finish(shots(folder, scene, volume, **options), progress)


def shots(folder, scene=None, volume=None, *, views=24, size=(128, 128), samples=32, seed=0, cameras=None):
    """What `capture` does, view by view: a generator of (views done, views) that returns the Capture."""
    if bpy.app.version < (5, 0):
        raise ValueError(
            f"Blender {bpy.app.version_string} renders volumes half a voxel aside; Blender 5.0 or later is needed"
        )
    placed = chosen(scene or bpy.context.scene, volume)
    path = vdb_of(placed)
    entry = volume_entry(placed, folder, 1.0)
    if "extinction_color" in entry["medium"]:
        raise refused(
            named("object", placed.object),
            f"its extinction has the color {entry['medium']['extinction_color']}, which no capture states",
            "choose a black Absorption Color, or one grey color",
        )
    lattice, box = lattice_of(placed, path, entry["grid"])
    if cameras is None:
        cameras = sphere_cameras(views, *padding.world_box(lattice, box), *size)
    settings = Settings(density_scale=entry["medium"]["density_scale"], samples=samples, seed=seed, step_rate=0.5)
    with scene_beside() as beside:
        stage = Stage(settings, path, entry["grid"], transform=placed.matrix, scene=beside)
        return (yield from capture_steps(stage, cameras, folder, lattice))


def chosen(scene, name=None):
    """The Placed volume of that name, or the only one. Raises Refused where there is none, or several without a name."""
    found = [placed for placed in placed_objects(scene) if placed.object.type == "VOLUME"]
    named_so = [placed for placed in found if name is None or placed.object.name == name]
    if len(named_so) == 1:
        return named_so[0]
    names = ", ".join(placed.object.name for placed in found) or "none"
    found_text = (
        f"{len(named_so)} volumes are rendered"
        if name is None
        else f"{len(named_so)} volumes named {name!r} are rendered"
    )
    raise refused(
        named("scene", scene), f"{found_text} (all: {names})", "name the one, or disable the others in renders"
    )


def count_volumes(scene):
    """How many volumes a render of the scene shows."""
    return sum(placed.object.type == "VOLUME" for placed in placed_objects(scene))
