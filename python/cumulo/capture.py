"""Multi-view captures: cameras, the pictures they took and how these were made.

A capture is a folder with `transforms.json` in the convention of NeRF tools, one EXR a view beside
it, and Cumulo's optional keys (`model`, `background`, `pixel_filter`, `near`, `density_scale`,
`emission`, `lattice`, `camera_model`). Cameras look down their -Z with +Y up; pixel (0, 0) is the
top left one and its centre lies at (0.5, 0.5). Matrices act on column vectors.
"""

import dataclasses
import json
import math
import os
import pathlib
import tempfile

import numpy as np

MODELS = ("absorption", "emission-absorption")


@dataclasses.dataclass(frozen=True)
class Camera:
    """A camera and its raster; focal lengths in pixels, or pixels per world unit if orthographic."""

    camera_to_world: np.ndarray
    fl_x: float
    fl_y: float
    cx: float
    cy: float
    width: int
    height: int
    orthographic: bool = False

    def rays(self, offsets=((0.5, 0.5),)):
        """World origins and unit directions, each [offset, height, width, 3] in f64, through the
        points at `offsets` (x, y in 0..1) of every pixel."""
        off = np.asarray(offsets, dtype=np.float64)[:, None, None, :]
        px, py = np.meshgrid(np.arange(self.width), np.arange(self.height))
        x = (px[None] + off[..., 0] - self.cx) / self.fl_x
        y = (self.cy - py[None] - off[..., 1]) / self.fl_y
        zero, one = np.zeros_like(x), np.ones_like(x)
        if self.orthographic:
            origin, direction = np.stack([x, y, zero], -1), np.stack([zero, zero, -one], -1)
        else:
            origin, direction = np.zeros(x.shape + (3,)), np.stack([x, y, -one], -1)
        direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
        rotation, position = self.camera_to_world[:3, :3], self.camera_to_world[:3, 3]
        return origin @ rotation.T + position, direction @ rotation.T


@dataclasses.dataclass
class Capture:
    """Views of one volume: `frames` pairs each camera with its picture's path."""

    frames: list
    model: str = "absorption"
    background: tuple = (1.0, 1.0, 1.0)
    pixel_filter: str = "point"
    near: float = 0.0
    density_scale: float = 1.0
    emission: tuple = (1.0, 1.0, 1.0)
    lattice: np.ndarray | None = None

    @classmethod
    def read(cls, path):
        """Reads a `transforms.json`. Raises ValueError naming the file and the frame that is wrong."""
        path = pathlib.Path(path)
        if path.is_dir():
            path = path / "transforms.json"
        data = json.loads(path.read_text())
        frames = []
        for index, frame in enumerate(data.get("frames", [])):
            try:
                frames.append((_camera({**data, **frame}), path.parent / frame["file_path"]))
            except (KeyError, ValueError, TypeError) as error:
                raise ValueError(f"{path}: frame {index} cannot be used: {error!r}") from error
        if not frames:
            raise ValueError(f"{path}: no frames; a capture needs at least one")
        known = {field.name for field in dataclasses.fields(cls)} - {"frames"}
        options = {key: data[key] for key in known if key in data}
        for key in ("background", "emission"):
            if key in options:
                options[key] = tuple(options[key])
        if "lattice" in options:
            options["lattice"] = np.array(options["lattice"], dtype=np.float64)
        if options.get("model", "absorption") not in MODELS:
            raise ValueError(f"{path}: model {options['model']!r} is not one of {', '.join(MODELS)}")
        return cls(frames, **options)

    def write(self, path):
        """Writes `transforms.json`, whole or not at all; pictures are named relative to its folder."""
        path = pathlib.Path(path)
        data = {
            "model": self.model,
            "background": list(self.background),
            "pixel_filter": self.pixel_filter,
            "near": self.near,
            "density_scale": self.density_scale,
        }
        if self.model == "emission-absorption":
            data["emission"] = list(self.emission)
        if self.lattice is not None:
            data["lattice"] = np.asarray(self.lattice).tolist()
        data["frames"] = [_frame(camera, picture, path.parent) for camera, picture in self.frames]
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".writing-") as folder:
            draft = pathlib.Path(folder) / path.name
            draft.write_text(json.dumps(data, indent=1) + "\n")
            os.replace(draft, path)


def _camera(frame):
    width, height = int(frame["w"]), int(frame["h"])
    orthographic = frame.get("camera_model") == "ORTHOGRAPHIC"
    if "fl_x" in frame:
        fl_x = float(frame["fl_x"])
    elif "camera_angle_x" in frame and not orthographic:
        fl_x = 0.5 * width / math.tan(0.5 * float(frame["camera_angle_x"]))
    else:
        raise ValueError("neither fl_x nor camera_angle_x is given")
    matrix = np.array(frame["transform_matrix"], dtype=np.float64)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise ValueError("transform_matrix is not a finite 4x4 matrix")
    matrix[:3, :3] /= np.linalg.norm(matrix[:3, :3], axis=0)
    return Camera(
        matrix,
        fl_x,
        float(frame.get("fl_y", fl_x)),
        float(frame.get("cx", width / 2)),
        float(frame.get("cy", height / 2)),
        width,
        height,
        orthographic,
    )


def _frame(camera, picture, folder):
    frame = {
        "file_path": os.path.relpath(picture, folder),
        "transform_matrix": camera.camera_to_world.tolist(),
        "fl_x": camera.fl_x,
        "fl_y": camera.fl_y,
        "cx": camera.cx,
        "cy": camera.cy,
        "w": camera.width,
        "h": camera.height,
    }
    if camera.orthographic:
        frame["camera_model"] = "ORTHOGRAPHIC"
    return frame


def look_at(eye, target, up=(0.0, 0.0, 1.0)):
    """Camera-to-world matrix of a camera at `eye` that looks at `target`."""
    eye, target, up = (np.asarray(v, dtype=np.float64) for v in (eye, target, up))
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross(up, back)
    if np.linalg.norm(right) < 1e-6:  # looking along `up`: any other will do
        right = np.cross(np.roll(up, 1), back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :4] = np.stack([right, np.cross(back, right), back, eye], axis=1)
    return matrix


def sphere_cameras(count, low, high, width, height, field_of_view=math.radians(40)):
    """`count` perspective cameras on a Fibonacci sphere around the world box `low`..`high`, each with
    the whole box in view."""
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    centre, radius = 0.5 * (low + high), 0.5 * np.linalg.norm(high - low)
    focal = 0.5 * max(width, height) / math.tan(0.5 * field_of_view)
    # The narrower side of the picture must hold the bounding sphere, whose outline is a tangent cone.
    half = math.atan(0.5 * min(width, height) / focal)
    distance = 1.05 * radius / math.sin(half)
    cameras = []
    for i in range(count):
        z = 1.0 - 2.0 * (i + 0.5) / count
        turn = math.pi * (3.0 - math.sqrt(5.0)) * i
        ring = math.sqrt(1.0 - z * z)
        eye = centre + distance * np.array([ring * math.cos(turn), ring * math.sin(turn), z])
        cameras.append(Camera(look_at(eye, centre), focal, focal, width / 2, height / 2, width, height))
    return cameras
