"""Objects linked into a scene."""

import pathlib

import bpy
import numpy as np
from mathutils import Matrix


def link_object(scene, name, data, matrix=None):
    """Links a new object of `data` into a scene, at `matrix` (object to world)."""
    thing = bpy.data.objects.new(name, data)
    scene.collection.objects.link(thing)
    if matrix is not None:
        thing.matrix_world = Matrix(np.asarray(matrix).tolist())
    return thing


def load_volume(scene, path):
    """Links the VDB at `path` into a scene, where its own transform puts it. Raises
    ValueError where Blender cannot read it."""
    volume = bpy.data.volumes.new(pathlib.Path(path).stem)
    volume.filepath = str(pathlib.Path(path).resolve())
    volume.render.precision = "FULL"
    volume.render.clipping = 0.0
    volume.render.space = "WORLD"
    if not volume.grids.load():
        error = volume.grids.error_message
        bpy.data.volumes.remove(volume)
        raise ValueError(f"{path}: Blender cannot read it: {error}")
    return link_object(scene, "volume", volume)


def box_mesh(scene, low, high, matrix=None):
    """Links a closed box, moved by `matrix`, whose inside is the medium."""
    corners = np.array([[(low, high)[i >> axis & 1][axis] for axis in range(3)] for i in range(8)])
    if matrix is not None:
        # Into the corners, for an object's own matrix loses its shear.
        corners = corners @ np.asarray(matrix)[:3, :3].T + np.asarray(matrix)[:3, 3]
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    mesh = bpy.data.meshes.new("box")
    mesh.from_pydata(corners.tolist(), [], faces)
    return link_object(scene, "box", mesh)


def place_camera(scene, camera, near):
    """Makes the scene's camera and raster of a pinhole or orthographic camera.

    With horizontal fit Blender's view plane at unit distance is, in terms of its pixel size ps =
    sensor/lens/W (orthographic: ortho_scale/W) and ycor = aspect_y/aspect_x,
    x = (px - W/2 + shift_x W) ps, y = ((H/2 - py) ycor + shift_y W) ps; ours is
    x = (px - cx)/fl_x, y = (cy - py)/fl_y.
    """
    data = bpy.data.cameras.new("camera")
    thing = link_object(scene, "camera", data, camera.camera_to_world)
    width, height = camera.width, camera.height
    y_per_x = camera.fl_x / camera.fl_y
    data.sensor_fit = "HORIZONTAL"
    if camera.orthographic:
        data.type = "ORTHO"
        data.ortho_scale = width / camera.fl_x
    else:
        data.sensor_width = 36.0
        data.lens = data.sensor_width * camera.fl_x / width
    data.shift_x = (width / 2 - camera.cx) / width
    data.shift_y = (camera.cy - height / 2) * y_per_x / width
    data.clip_start = max(near, 1e-6)
    data.clip_end = 1e9
    # Blender takes aspects from 1 up.
    scene.render.pixel_aspect_x = max(1.0, 1.0 / y_per_x)
    scene.render.pixel_aspect_y = max(1.0, y_per_x)
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.camera = thing
    return thing
