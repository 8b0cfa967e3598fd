"""Motion of a scene while the shutter is open: the camera's is exported, and that of all else is complained about."""

import dataclasses

import numpy as np

from .cameras import camera_of
from .refusal import Complaint, named
from .visible import placed_objects

# Where the middle of the open time lies, in shutter times after the frame.
POSITIONS = {"START": 0.5, "CENTER": 0.0, "END": -0.5}


def blurred_camera(scene, complaints):
    """The scene's camera at its present frame, in the middle of the time in which the shutter is open where motion blur is
    on: with its motion, and a complaint about all else that moves or that no camera here does. Raises Refused as `camera_of`
    does."""
    if not scene.render.use_motion_blur:
        return camera_of(scene, complaints)
    for complaint in _complaints_of(scene, complaints):
        complaints.add(complaint)
    time = scene.render.motion_blur_shutter
    middle = scene.frame_current_final + time * POSITIONS[scene.render.motion_blur_position]
    now = scene.frame_current, scene.frame_subframe
    moments = []
    try:
        for moment in (middle - 0.5 * time, middle, middle + 0.5 * time):
            whole = int(np.floor(moment))
            scene.frame_set(whole, subframe=moment - whole)
            camera = camera_of(scene, complaints)
            moments.append((camera, _places(scene, complaints)))
    finally:
        scene.frame_set(now[0], subframe=now[1])
    (start, before), (camera, places), (end, after) = moments
    for name, place in places.items():
        if not all(np.array_equal(other.get(name), place) for other in (before, after)):
            complaints.add(
                Complaint(
                    f"object {name!r}",
                    "it moves while the shutter is open, and only the motion of cameras is blurred",
                    "switch its Motion Blur off (Object Properties), or Motion Blur (Render Properties)",
                    "it stands still in each picture",
                )
            )
    if any((other.fl_x, other.fl_y) != (camera.fl_x, camera.fl_y) for other in (start, end)):
        complaints.add(
            Complaint(
                named("camera", scene.camera),
                "its focal length changes while the shutter is open",
                "switch Motion Blur off (Render Properties)",
                "each picture has one focal length",
            )
        )
    if not scene.camera.cycles.use_motion_blur or all(
        np.array_equal(other.camera_to_world, camera.camera_to_world) for other in (start, end)
    ):
        return camera
    ends = zip(("transform_matrix_start", "transform_matrix_end"), (start, end))
    motion = {key: other.camera_to_world.tolist() for key, other in ends}
    return dataclasses.replace(camera, extra=camera.extra | motion)


def _places(scene, complaints):
    """Matrices of the volumes and lights that are rendered with motion blur, by the objects' names."""
    return {
        placed.object.name: placed.matrix
        for placed in placed_objects(scene, complaints)
        if placed.object.type in ("VOLUME", "LIGHT") and placed.object.original.cycles.use_motion_blur
    }


def _complaints_of(scene, complaints):
    """The complaints about motion blur that an export can do without; `complaints` are those that there are."""
    curve = scene.render.motion_blur_shutter_curve
    curve.initialize()
    opened = [curve.evaluate(curve.curves[0], 0.05 + 0.1 * i) for i in range(10)]
    if max(opened) - min(opened) > 1e-3:
        yield Complaint(
            named("scene", scene),
            "its shutter curve is not flat",
            "make it flat (Render Properties > Motion Blur > Shutter Curve)",
            "the shutter opens and closes at once",
        )
    if scene.cycles.rolling_shutter_type != "NONE":
        yield Complaint(
            named("scene", scene),
            "it has a rolling shutter",
            "switch Rolling Shutter off (Render Properties > Motion Blur)",
            "all rows of a picture are taken at once",
        )
    for placed in placed_objects(scene, complaints):
        thing = placed.object
        if thing.type == "VOLUME" and thing.original.cycles.use_motion_blur and _has_velocities(thing.data):
            yield Complaint(
                named("object", thing),
                f"it is blurred by its velocities ({thing.data.velocity_grid})",
                "switch its Motion Blur off (Object Properties)",
                "its densities stand still in each picture",
            )


def _has_velocities(volume):
    """True if a volume has the grid that Cycles takes its velocities from, whole or as three."""
    if not volume.grids.is_loaded:
        volume.grids.load()
    names = {grid.name for grid in volume.grids}
    wanted = volume.velocity_grid
    return bool(wanted) and (wanted in names or {wanted + axis for axis in "XYZ"} <= names)
