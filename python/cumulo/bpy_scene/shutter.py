"""Motion of a scene while the shutter is open: that of the camera, of volumes and of surfaces is exported."""

import dataclasses

import numpy as np

from .cameras import camera_of
from .refusal import Complaint, named
from .visible import placed_objects

# Where the middle of the open time lies, in shutter times after the frame.
POSITIONS = {"START": 0.5, "CENTER": 0.0, "END": -0.5}


def blurred_camera(scene, complaints):
    """The scene's camera at its present frame, in the middle of the time in which the shutter is open where motion blur is
    on, with its motion; and the motions of volumes and surfaces in that time, matrices as it opens, in the middle and as it
    closes, by the keys of `keyed`. Adds what else moves to the Complaints. Raises Refused as `camera_of` does."""
    if not scene.render.use_motion_blur:
        return camera_of(scene, complaints), {}
    for complaint in _complaints_of(scene, complaints):
        complaints.add(complaint)
    time, frame = scene.render.motion_blur_shutter, scene.frame_current_final
    middle = frame + time * POSITIONS[scene.render.motion_blur_position]
    now = scene.frame_current, scene.frame_subframe
    moments, blown = [], False
    try:
        for moment in (middle - 0.5 * time, middle, middle + 0.5 * time):
            whole = int(np.floor(moment))
            scene.frame_set(whole, subframe=moment - whole)
            camera = camera_of(scene, complaints)
            moments.append((camera, _places(scene, complaints)))
    finally:
        scene.frame_set(now[0], subframe=now[1])
    (start, before), (camera, places), (end, after) = moments
    motions = {}
    for key, (kind, place) in places.items():
        ends = [other.get(key, (kind, None))[1] for other in (before, after)]
        if all(other is not None and np.array_equal(other, place) for other in ends):
            continue
        if kind == "LIGHT" or any(other is None for other in ends):
            complaints.add(
                Complaint(
                    f"object {key[0]!r}",
                    "it moves while the shutter is open, and the motion of lights is not blurred",
                    "switch its Motion Blur off (Object Properties), or Motion Blur (Render Properties)",
                    "it stands still in each picture",
                )
            )
        else:
            motions[key] = (ends[0], place, ends[1])
    if any((other.fl_x, other.fl_y) != (camera.fl_x, camera.fl_y) for other in (start, end)):
        complaints.add(
            Complaint(
                named("camera", scene.camera),
                "its focal length changes while the shutter is open",
                "switch Motion Blur off (Render Properties)",
                "each picture has one focal length",
            )
        )
    blown = any(placed.object.type == "VOLUME" and goes_with_velocities(placed.object) for placed in placed_objects(scene, complaints))
    still = not scene.camera.cycles.use_motion_blur or all(
        np.array_equal(other.camera_to_world, camera.camera_to_world) for other in (start, end)
    )
    if still and not (motions or blown):
        return camera, {}
    ends = [camera, camera] if still else [start, end]
    keys = zip(("transform_matrix_start", "transform_matrix_end"), ends)
    motion = {key: other.camera_to_world.tolist() for key, other in keys}
    if motions or blown:
        motion |= {"shutter_open": middle - 0.5 * time - frame, "shutter_close": middle + 0.5 * time - frame}
    return dataclasses.replace(camera, extra=camera.extra | motion), motions


def keyed(placed):
    """Pairs of a key, by which a placed object is told at other times, and the object, of a list of Placed."""
    count = {}
    for each in placed:
        number = count[each.object.name] = count.get(each.object.name, -1) + 1
        yield (each.object.name, number), each


def _places(scene, complaints):
    """Types and matrices of the objects that are rendered with motion blur, by their keys."""
    return {
        key: (placed.object.type, placed.matrix)
        for key, placed in keyed(placed_objects(scene, complaints))
        if placed.object.original.cycles.use_motion_blur
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
        if thing.type != "VOLUME" or not thing.original.cycles.use_motion_blur:
            continue
        if goes_with_velocities(thing):
            if scene.render.motion_blur_position == "END":
                yield Complaint(
                    named("object", thing),
                    "its velocities blur a frame at whose end the shutter closes, and Cycles takes them for a later time",
                    "choose the position Center or Start (Render Properties > Motion Blur)",
                    "the volume is blurred by where it was",
                )
        elif _has_velocities(thing.data):
            yield Complaint(
                named("object", thing),
                f"it is blurred by its velocities ({thing.data.velocity_grid}), by three grids or a Velocity Scale",
                "write one grid of vectors with the scale 1, or switch its Motion Blur off (Object Properties)",
                "its densities stand still in each picture",
            )


def goes_with_velocities(thing):
    """True if a volume object is blurred by velocities that an export states."""
    volume = thing.data
    if not volume.grids.is_loaded:
        volume.grids.load()
    whole = volume.velocity_grid in {grid.name for grid in volume.grids} and volume.velocity_scale == 1.0
    return thing.original.cycles.use_motion_blur and whole


def _has_velocities(volume):
    """True if a volume has the grid that Cycles takes its velocities from, whole or as three."""
    if not volume.grids.is_loaded:
        volume.grids.load()
    names = {grid.name for grid in volume.grids}
    wanted = volume.velocity_grid
    return bool(wanted) and (wanted in names or {wanted + axis for axis in "XYZ"} <= names)
