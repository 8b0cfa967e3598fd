"""Multi-view captures: cameras, the pictures they took and how these were made.

A capture is a folder with `transforms.json` in the convention of NeRF tools, one EXR a view beside
it, and Cumulo's optional keys (`model`, `background`, `pixel_filter`, `near`, `density_scale`,
`emission`, `emission_model`, `transfer`, `lattice`, `camera_model`). Cameras look down their -Z with
+Y up; pixel (0, 0) is the top left one and its centre lies at (0.5, 0.5). Matrices act on column
vectors. Keys that Cumulo does not use are kept when a capture is read and written again; what would
change the pictures and is not understood is refused.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import pathlib
import tempfile
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from .options import Path

Matrix = npt.NDArray[np.float64]
MODELS = ("absorption", "emission-absorption", "pre-shaded", "scattering")
EMISSION_MODELS = ("grey", "linear")
PIXEL_FILTERS = ("point", "box")
PINHOLES = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "PERSPECTIVE")
DISTORTIONS = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
# Keys of a camera, which stand in its frame or at the top for all frames.
INTRINSICS = ("camera_model", "fl_x", "fl_y", "camera_angle_x", "camera_angle_y", "cx", "cy", "w", "h")


def default_emission(model: str) -> tuple[float, ...]:
    """Radiance of the source of a medium of which nobody states one: a scattering medium does not emit."""
    return (0.0, 0.0, 0.0) if model == "scattering" else (1.0, 1.0, 1.0)


@dataclasses.dataclass(frozen=True)
class Camera:
    """A camera and its raster; focal lengths in pixels, or pixels per world unit if orthographic.

    `near` is the distance along the viewing axis before which nothing is seen, None for that of the
    capture. `extra` holds the keys of the frame that have no other place.
    """

    camera_to_world: Matrix
    fl_x: float
    fl_y: float
    cx: float
    cy: float
    width: int
    height: int
    orthographic: bool = False
    near: float | None = None
    extra: dict[str, Any] = dataclasses.field(default_factory=dict)

    def rays(self, offsets: npt.ArrayLike = ((0.5, 0.5),)) -> tuple[Matrix, Matrix]:
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
    """Views of one volume: `frames` pairs each camera with its picture's path.

    `emission` is the radiance of the source per channel (left empty, it is 1, and 0 where the model is "scattering"),
    `emission_model` how it follows the density
    ("grey": not at all, "linear": in proportion). `transfer` is a transfer function as `.tf.json`
    holds it under that key, which then stands in the place of `emission`. `lattice` takes the volume's
    voxel indices to the world. `extra` holds the keys at the top that have no other place.
    """

    frames: list[tuple[Camera, pathlib.Path]]
    model: str = "absorption"
    background: tuple[float, ...] = (1.0, 1.0, 1.0)
    pixel_filter: str = "point"
    near: float = 0.0
    density_scale: float = 1.0
    emission: tuple[float, ...] = ()
    lattice: Matrix | None = None
    emission_model: str = "grey"
    transfer: dict[str, Any] | None = None
    extra: dict[str, Any] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.emission) == 0:
            self.emission = default_emission(self.model)

    @classmethod
    def read(cls, path: Path) -> Capture:
        """Reads a `transforms.json`. Raises ValueError naming the file and the frame that is wrong."""
        path = pathlib.Path(path)
        if path.is_dir():
            path = path / "transforms.json"
        # Windows editors put a byte order mark before the text.
        try:
            data = json.loads(path.read_text(encoding="utf-8-sig"))
        except ValueError as error:
            raise ValueError(f"{path}: it is no JSON: {error}") from error
        if not isinstance(data, dict) or not isinstance(data.get("frames"), list) or not data["frames"]:
            raise ValueError(f"{path}: no frames; a capture needs at least one")
        # Null counts as absent.
        top = {key: value for key, value in data.items() if value is not None and key != "frames"}
        shared = {key: top.pop(key) for key in (*INTRINSICS, *DISTORTIONS) if key in top}
        frames = []
        for index, frame in enumerate(data["frames"]):
            try:
                frames.append(_read_frame(frame, shared, path.parent))
            except (AttributeError, KeyError, ValueError, TypeError) as error:
                raise ValueError(f"{path}: frame {index} cannot be used: {error!r}") from error
        own = {field.name for field in dataclasses.fields(cls)} - {"frames", "extra"}
        options = {key: top.pop(key) for key in list(top) if key in own}
        for key in ("background", "emission"):
            if key in options:
                options[key] = tuple(options[key])
        if "lattice" in options:
            options["lattice"] = _matrix(options["lattice"], "lattice")
        for key, values in (("model", MODELS), ("emission_model", EMISSION_MODELS), ("pixel_filter", PIXEL_FILTERS)):
            if key in options and options[key] not in values:
                raise ValueError(f"{path}: {key} {options[key]!r} is not one of {', '.join(values)}")
        if "transfer" in options and not isinstance(options["transfer"], dict):
            raise ValueError(f"{path}: transfer is not a transfer function but {type(options['transfer']).__name__}")
        return cls(frames, **options, extra=top)

    def write(self, path: Path) -> None:
        """Writes `transforms.json`, whole or not at all; pictures are named relative to its folder.

        Raises ValueError where a key of `extra` is one of the capture's own, or a number is not finite.
        """
        path = pathlib.Path(path)
        data: dict[str, Any] = {
            "model": self.model,
            "background": list(self.background),
            "pixel_filter": self.pixel_filter,
            "near": self.near,
            "density_scale": self.density_scale,
            "emission": list(self.emission),
            "emission_model": self.emission_model,
        }
        if self.transfer is not None:
            data["transfer"] = self.transfer
        if self.lattice is not None:
            data["lattice"] = np.asarray(self.lattice).tolist()
        reserved = data.keys() | {"frames", "transfer", "lattice", *INTRINSICS, *DISTORTIONS}
        data |= _checked_extra(self.extra, reserved, path)
        data["frames"] = [_frame(camera, picture, path) for camera, picture in self.frames]
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".writing-") as folder:
            draft = pathlib.Path(folder) / path.name
            draft.write_text(json.dumps(data, indent=1, allow_nan=False) + "\n", encoding="utf-8")
            os.replace(draft, path)


def _checked_extra(extra: dict[str, Any], reserved: Iterable[str], path: pathlib.Path) -> dict[str, Any]:
    taken = sorted(extra.keys() & set(reserved))
    if taken:
        raise ValueError(f"{path}: extra key {taken[0]!r} is one of the capture's own; set its field instead")
    return extra


def _read_frame(frame: Mapping[str, Any], shared: Mapping[str, Any], folder: pathlib.Path) -> tuple[Camera, pathlib.Path]:
    frame = {key: value for key, value in frame.items() if value is not None}
    picture = folder / frame.pop("file_path")
    # "view.0001" has no suffix that is one of a picture.
    if not any(letter.isalpha() and letter.isascii() for letter in picture.suffix):
        picture = picture.with_name(picture.name + ".exr")
    matrix = _matrix(frame.pop("transform_matrix"), "transform_matrix")
    # A frame's own angle outdoes a length that was given for all.
    shared = {
        key: value
        for key, value in shared.items()
        if not any(key == f"fl_{axis}" and f"camera_angle_{axis}" in frame for axis in "xy")
    }
    keys = {**shared, **{key: frame.pop(key) for key in (*INTRINSICS, *DISTORTIONS) if key in frame}}
    near = float(frame.pop("near")) if "near" in frame else None
    return _camera(matrix, keys, near, frame), picture


def _matrix(rows: npt.ArrayLike, name: str) -> Matrix:
    matrix = np.array(rows, dtype=np.float64)
    if matrix.shape == (3, 4):
        matrix = np.vstack([matrix, (0, 0, 0, 1)])
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise ValueError(f"{name} is not a finite 4x4 matrix")
    return matrix


def _camera(matrix: Matrix, keys: Mapping[str, Any], near: float | None, extra: dict[str, Any]) -> Camera:
    width, height = int(keys["w"]), int(keys["h"])
    model = keys.get("camera_model", "PINHOLE")
    orthographic = model == "ORTHOGRAPHIC"
    if not orthographic and model not in PINHOLES:
        raise ValueError(f"camera_model is {model!r}; undistort the pictures to a pinhole camera first")
    for key in DISTORTIONS:
        if keys.get(key):
            raise ValueError(f"lens distortion ({key} is {keys[key]}); undistort the pictures first")

    def focal(axis: str, pixels: int) -> float | None:
        if f"fl_{axis}" in keys:
            return float(keys[f"fl_{axis}"])
        if f"camera_angle_{axis}" in keys and not orthographic:
            return 0.5 * pixels / math.tan(0.5 * float(keys[f"camera_angle_{axis}"]))
        return None

    fl_x, fl_y = focal("x", width), focal("y", height)
    if fl_x is None:
        fl_x = fl_y
    if fl_x is None:
        raise ValueError("neither fl_x nor camera_angle_x is given")
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    # Columns of unit length are kept to the last bit, so that what was written is what is read.
    if (np.abs(lengths * lengths - 1.0) >= 8 * np.finfo(np.float64).eps).any():
        matrix[:3, :3] /= lengths
    return Camera(
        matrix,
        fl_x,
        fl_x if fl_y is None else fl_y,
        float(keys.get("cx", width / 2)),
        float(keys.get("cy", height / 2)),
        width,
        height,
        orthographic,
        near,
        extra,
    )


def _frame(camera: Camera, picture: pathlib.Path, path: pathlib.Path) -> dict[str, Any]:
    frame: dict[str, Any] = {
        "file_path": pathlib.Path(os.path.relpath(picture, path.parent)).as_posix(),
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
    if camera.near is not None:
        frame["near"] = camera.near
    return frame | _checked_extra(camera.extra, frame.keys() | {"near", *INTRINSICS, *DISTORTIONS}, path)


def look_at(eye: npt.ArrayLike, target: npt.ArrayLike, up: npt.ArrayLike = (0.0, 0.0, 1.0)) -> Matrix:
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


def sphere_cameras(count: int, low: npt.ArrayLike, high: npt.ArrayLike, width: int, height: int,
                   field_of_view: float = math.radians(40)) -> list[Camera]:  # fmt: skip
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
