"""Cameras of a scene as those of captures."""

import numpy as np

from ..capture import Camera
from .refusal import Complaint, named, refused
from .visible import evaluated


def raster(scene):
    """Width and height of the scene's pictures in pixels."""
    render = scene.render
    return tuple(
        max(1, size * render.resolution_percentage // 100) for size in (render.resolution_x, render.resolution_y)
    )


def _complaints_of(scene, thing):
    """The complaints about a scene's camera that an export can do without."""
    data, render = thing.data, scene.render
    if data.dof.use_dof and data.dof.focus_object and data.dof.focus_subtarget:
        yield Complaint(
            named("camera", thing),
            f"its focus follows the bone {data.dof.focus_subtarget!r}",
            "let it follow an object, or state the distance",
            "the focus follows the armature itself",
        )
    if render.use_multiview:
        yield Complaint(
            named("scene", scene),
            "it has stereoscopic views",
            "switch Stereoscopy off",
            "the pictures are those of the camera itself",
        )
    if render.use_border:
        yield Complaint(
            named("scene", scene),
            "a border crops its pictures",
            "switch Render Region off; `cumulo render --crop` renders a part",
            "the pictures are whole",
        )


def camera_of(scene, complaints):
    """The scene's camera at its present frame. Adds what can be left out to the Complaints, and raises Refused about what
    cannot."""
    if scene.camera is None:
        raise refused(named("scene", scene), "it has no camera", "add one (Add > Camera)")
    thing = scene.camera.evaluated_get(evaluated(scene, complaints))
    where = named("camera", thing)
    if thing.type != "CAMERA":
        raise refused(where, f"the scene's camera is a {thing.type.lower()}", "choose a camera")
    data, render = thing.data, scene.render
    if data.type not in ("PERSP", "ORTHO"):
        raise refused(where, f"its type is {data.type.lower()}", "make it perspective or orthographic")
    for complaint in _complaints_of(scene, thing):
        complaints.add(complaint)
    matrix = _pose(thing)
    width, height = raster(scene)
    ratio = render.pixel_aspect_y / render.pixel_aspect_x
    across = data.sensor_fit == "HORIZONTAL" or (
        data.sensor_fit == "AUTO" and width * render.pixel_aspect_x >= height * render.pixel_aspect_y
    )
    fitted = width if across else ratio * height
    sensor = data.sensor_height if data.sensor_fit == "VERTICAL" else data.sensor_width
    size = (data.ortho_scale if data.type == "ORTHO" else sensor / data.lens) / fitted
    return Camera(
        matrix,
        fl_x=1.0 / size,
        fl_y=1.0 / (size * ratio),
        cx=width / 2 - data.shift_x * fitted,
        cy=height / 2 + data.shift_y * fitted / ratio,
        width=width,
        height=height,
        orthographic=data.type == "ORTHO",
        near=float(data.clip_start),
        extra=_aperture(thing, matrix) if data.dof.use_dof else {},
    )


def _pose(thing):
    """Camera to world, [4, 4] f64. Blender takes no notice of a camera's scale."""
    matrix = np.array(thing.matrix_world, dtype=np.float64)
    matrix[:3, :3] /= np.linalg.norm(matrix[:3, :3], axis=0)
    if np.abs(matrix[:3, :3].T @ matrix[:3, :3] - np.eye(3)).max() > 1e-4 or np.linalg.det(matrix[:3, :3]) < 0:
        raise refused(named("camera", thing), "its matrix shears or mirrors", "clear the scale of its parents")
    return matrix


def _aperture(thing, matrix):
    """Keys of a `transforms.json` for the aperture of a camera, whose lens is measured in millimeters and the world in
    meters."""
    data = thing.data
    dof, width = data.dof, 1.0 if data.type == "ORTHO" else 1e-3 * data.lens
    focus = dof.focus_distance
    if dof.focus_object:
        focus = abs((np.array(dof.focus_object.matrix_world.translation) - matrix[:3, 3]) @ matrix[:3, 2])
    keys = {"aperture_radius": 0.5 * width / max(dof.aperture_fstop, 1e-5), "focus_distance": float(focus)}
    if dof.aperture_blades >= 3:
        keys |= {"aperture_blades": dof.aperture_blades, "aperture_rotation": dof.aperture_rotation}
    if dof.aperture_ratio != 1.0:
        keys["aperture_ratio"] = dof.aperture_ratio
    return keys


def far_complaint(scene, camera, box):
    """The Complaint about a camera whose clip end cuts off a part of the world box (low, high), or None."""
    corners = np.array([[box[i >> axis & 1][axis] for axis in range(3)] for i in range(8)])
    depth = (corners - camera.camera_to_world[:3, 3]) @ -camera.camera_to_world[:3, 2]
    end = scene.camera.data.clip_end
    if depth.max() <= end:
        return None
    return Complaint(
        named("camera", scene.camera),
        f"its clip end {end:g} cuts volumes off",
        f"raise it above {depth.max():.6g}",
        "nothing is cut off",
    )


def sees(camera, centre, radius):
    """True if a sphere may be in the camera's picture."""
    at = (np.asarray(centre) - camera.camera_to_world[:3, 3]) @ camera.camera_to_world[:3, :3]
    x = (np.array([0, camera.width]) - camera.cx) / camera.fl_x
    y = (camera.cy - np.array([camera.height, 0])) / camera.fl_y
    if camera.orthographic:
        return bool(x[0] - radius < at[0] < x[1] + radius and y[0] - radius < at[1] < y[1] + radius and at[2] < radius)
    # Distances to the planes through the eye and the edges of the picture, positive inside.
    planes = np.array([(1, 0, x[0]), (-1, 0, -x[1]), (0, 1, y[0]), (0, -1, -y[1]), (0, 0, -1)])
    return bool((planes @ at / np.linalg.norm(planes, axis=1) > -radius).all())
