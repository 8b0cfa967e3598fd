"""The same scene rendered by Cumulo and by Mitsuba, in independent batches [batch, height, width, channel]."""

import functools
import json
import os
import pathlib
import subprocess
import tempfile
import zlib

import drjit as dr
import fields
import mitsuba as mi
import numpy as np
import scenes

BATCHES = 16
THREADS = 2
WRITE_VDB = pathlib.Path(__file__).resolve().parents[2] / "peers" / "write_vdb.py"
mi.set_variant("scalar_rgb")
dr.set_thread_count(THREADS)


def rgb(values):
    """A colour as Mitsuba's dictionaries have it."""
    return {"type": "rgb", "value": list(values)}


def transform(matrix):
    """A matrix as Mitsuba's."""
    return mi.ScalarTransform4f(np.asarray(matrix, dtype=np.float64))


def peer_light(light):
    """A light of Mitsuba's.

    Area lights are black, and there is no other light beside them that they could hide: Cumulo's cast no shadows.
    """
    black = {"type": "diffuse", "reflectance": rgb((0, 0, 0))}
    match light:
        case scenes.Sun():
            return {"type": "directional", "direction": [-v for v in light.direction], "irradiance": rgb(light.irradiance)}
        case scenes.Point():
            return {"type": "point", "position": list(light.position), "intensity": rgb(light.intensity)}
        case scenes.Ball():
            emitter = {"type": "area", "radiance": rgb(light.radiance)}
            return {"type": "sphere", "center": list(light.centre), "radius": light.radius, "bsdf": black, "emitter": emitter}
        case scenes.Rectangle():
            first, second = (np.array(edge) for edge in light.edges)
            front = np.cross(first, second) / np.linalg.norm(np.cross(first, second))
            matrix = np.eye(4)
            middle = np.array(light.corner) + 0.5 * (first + second)
            # Mitsuba's rectangle is from -1 to 1.
            matrix[:3] = np.stack([0.5 * first, 0.5 * second, front, middle], axis=1)
            emitter = {"type": "area", "radiance": rgb(light.radiance)}
            return {"type": "rectangle", "to_world": transform(matrix), "bsdf": black, "emitter": emitter}


def peer_sky(sky):
    """Light from all around as Mitsuba's.

    Rows of its pictures run from pole to pole, with samples at both; ours have samples half a pixel off the poles and are
    constant beyond. Rows twice as dense, with those in between interpolated, are the same function. Columns lie alike. Its
    pictures begin towards local -Z and turn towards local X; Y is up.
    """
    if sky != "picture":
        return {"type": "constant", "radiance": rgb(sky)}
    rows = scenes.sky_picture()
    edges = 0.5 * (np.concatenate([rows[:1], rows]) + np.concatenate([rows, rows[-1:]]))
    dense = np.empty((2 * len(rows) + 1, *rows.shape[1:]))
    dense[0::2], dense[1::2] = edges, rows
    to_world = np.array([[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    return {"type": "envmap", "bitmap": mi.Bitmap(dense.astype(np.float32)), "to_world": transform(to_world)}


def peer_medium(scene):
    """The medium of Mitsuba's; where volumes overlap, extinctions add."""
    density = sum(fields.density(name) for name in scene.fields)
    grid = {"type": "gridvolume", "grid": mi.VolumeGrid(density[..., None]), "filter_type": "trilinear",
            "to_world": transform(scene.place)}  # fmt: skip
    return {"type": "heterogeneous", "scale": scene.density_scale, "sigma_t": grid,
            "albedo": {"type": "constvolume", "value": rgb(scene.colour)}, "phase": {"type": "hg", "g": scene.g}}  # fmt: skip


def peer_mesh(mesh, path):
    """A mesh of Mitsuba's; its faces reflect on both sides and emit on the front."""
    shape = {"type": "ply", "filename": str(mesh.write(path)), "face_normals": True,
             "bsdf": {"type": "twosided", "material": {"type": "diffuse", "reflectance": rgb(mesh.albedo)}}}  # fmt: skip
    if any(mesh.emission):
        shape["emitter"] = {"type": "area", "radiance": rgb(mesh.emission)}
    if mesh.inside:
        shape["exterior"] = shape["interior"] = {"type": "ref", "id": "medium"}
    return shape


def peer_sensor(view):
    """The camera of Mitsuba's; from inside, its rays begin in the medium."""
    sensor = {
        "type": "perspective", "fov": view.angle, "near_clip": 1e-4, "far_clip": 1e6,
        "to_world": mi.ScalarTransform4f().look_at(list(view.eye), list(view.target), [0, 0, 1]),
        "film": {"type": "hdrfilm", "width": view.size, "height": view.size, "rfilter": {"type": "box"}, "pixel_format": "rgb"},
    }  # fmt: skip
    return sensor | ({"medium": {"type": "ref", "id": "medium"}} if view.inside else {})


@functools.cache
def by_mitsuba(scene):
    """Mitsuba's batches.

    Its media do not emit. Where nothing is scattered, emission of a constant source is a matter of the transmittance T
    alone, which Mitsuba sees of a white sky: L = (1 - T) source + T sky.
    """
    assert scene.surface is None, "its media have no surfaces"
    if scene.emission:
        transmittance = by_mitsuba(scene.but(emission=None, sky=(1.0, 1.0, 1.0)))
        return np.array(scene.emission) + transmittance * (np.array(scene.sky) - np.array(scene.emission))
    cube = np.array(scene.place) @ np.array([[0.5, 0, 0, 0.5], [0, 0.5, 0, 0.5], [0, 0, 0.5, 0.5], [0, 0, 0, 1]])
    # Their depth counts segments, one more than scatterings. Roulette is off: they play it at every null collision, at most
    # 95 % to go on, so that the few paths that leave a dense medium carry weights of hundreds. Blocks of a given size make
    # the random numbers those of any number of threads.
    depth = -1 if scene.bounces is None else scene.bounces + 1
    integrator = {"type": "volpath", "max_depth": depth, "rr_depth": 2**30, "block_size": 8}
    with tempfile.TemporaryDirectory() as folder:
        meshes = {f"mesh{number}": peer_mesh(mesh, pathlib.Path(folder) / f"{number}.ply")
                  for number, mesh in enumerate(scene.meshes)}  # fmt: skip
        loaded = mi.load_dict(meshes | {
            "type": "scene",
            "integrator": integrator,
            "medium": peer_medium(scene),
            "sensor": peer_sensor(scene.view),
            "cube": {"type": "cube", "to_world": transform(cube), "bsdf": {"type": "null"},
                     "interior": {"type": "ref", "id": "medium"}},
            "sky": peer_sky(scene.sky),
        } | {f"light{number}": peer_light(light) for number, light in enumerate(scene.lights)})  # fmt: skip
    # Seeds of each scene's own: by common ones a chance deviation of camera rays would show in every scene.
    first = zlib.crc32(repr(scene).encode()) % 2**24
    pictures = [mi.render(loaded, seed=first + batch, spp=scene.paths[0]) for batch in range(BATCHES)]
    return np.array(pictures, dtype=np.float64)


def our_light(light):
    """A light of a scene file."""
    match light:
        case scenes.Sun():
            return {"type": "DistantLight", "direction": light.direction, "irradiance": light.irradiance}
        case scenes.Point():
            return {"type": "PointLight", "position": light.position, "intensity": light.intensity}
        case scenes.Ball():
            return {"type": "SphereLight", "centre": light.centre, "radius": light.radius, "radiance": light.radiance}
        case scenes.Rectangle():
            return {"type": "RectLight", "corner": light.corner, "edges": light.edges, "radiance": light.radiance}


class Cumulo:
    """Renders scenes by the program, in a folder of its own."""

    def __init__(self, run, folder):
        self.run, self.folder, self.count = run, folder, 0

    def vdb(self, name, place):
        """The VDB of a field, written under the Python that has OpenVDB's bindings."""
        density = fields.density(name)
        cells = density.shape[0]
        lattice = np.array(place) @ np.vstack([np.c_[np.eye(3) / cells, np.full(3, 0.5 / cells)], (0, 0, 0, 1)])
        paths = [self.folder / f"{name}{self.count}.{kind}" for kind in ("npy", "vdb")]
        np.save(paths[0], density)
        # An interpreter of another version must not find the packages of this one.
        clean = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
        subprocess.run(["/usr/bin/python3", WRITE_VDB, *paths, json.dumps(lattice.tolist())], check=True, env=clean)
        return paths[1]

    def scene_file(self, scene):
        """The scene as Cumulo reads it."""
        medium = {"density_scale": scene.density_scale, "albedo": scene.colour, "anisotropy": scene.g}
        if scene.emission:
            medium["emission"] = scene.emission
        if scene.surface:
            medium |= {"gradient_shading": scene.surface.half, "specular": scene.surface.specular,
                       "roughness": scene.surface.roughness}  # fmt: skip
        sky = {"type": "DomeLight", "radiance": scene.sky}
        if scene.sky == "picture":
            picture = self.folder / "sky.exr"
            mi.Bitmap(scenes.sky_picture().astype(np.float32)).write(str(picture))
            sky = {"type": "DomeLight", "texture": str(picture)}
        volumes = [{"file": str(self.vdb(name, scene.place)), "medium": medium} for name in scene.fields]
        path = self.folder / f"scene{self.count}.json"
        meshes = [{"file": str(mesh.write(self.folder / f"mesh{self.count}.{number}.ply")), "albedo": mesh.albedo,
                   "emission": mesh.emission} for number, mesh in enumerate(scene.meshes)]  # fmt: skip
        lights = [sky, *map(our_light, scene.lights)]
        path.write_text(json.dumps({"volumes": volumes, "lights": lights, "meshes": meshes}))
        return path

    def cameras(self, view):
        """A capture of as many views by the same camera as there are batches: each view has random numbers of its own."""
        camera = view.camera
        frames = [{"file_path": f"batch{batch:02}.exr", "transform_matrix": camera.camera_to_world.tolist()}
                  for batch in range(BATCHES)]  # fmt: skip
        model = "ORTHOGRAPHIC" if camera.orthographic else "PINHOLE"
        path = self.folder / f"cameras{self.count}.json"
        path.write_text(json.dumps({"w": camera.width, "h": camera.height, "fl_x": camera.fl_x, "camera_model": model,
                                    "frames": frames}))  # fmt: skip
        return path

    def render(self, scene):
        """Red, green, blue and alpha of each batch. Nothing may have happened that is known to bias pictures."""
        self.count += 1
        given = self.folder / f"given{self.count}"
        limit = [] if scene.bounces is None else ["--max-bounces", scene.bounces]
        report = self.run("render", self.scene_file(scene), "--cameras", self.cameras(scene.view), "--seed", 1, *limit,
                          "--samples", scene.paths[1], "--threads", THREADS, "-o", given)  # fmt: skip
        paths = report.get("paths") or {"majorant_violations": 0, "impossible_directions": 0}
        assert paths["majorant_violations"] == 0 and paths["impossible_directions"] == 0
        pictures = [np.array(mi.Bitmap(str(path)), dtype=np.float64) for path in sorted(given.glob("*.exr"))]
        assert len(pictures) == BATCHES
        return np.array(pictures)
