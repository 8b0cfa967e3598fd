"""Pictures of arrays along straight rays, and their derivatives, in NumPy. `cumulo.torch` makes them an operation of
PyTorch.

    lattice = Lattice.box(density.shape, voxel_size=0.1)
    picture = pictures.render(density, Cameras.around(lattice, 4, (256, 256)), lattice=lattice, density_scale=2.0)

Arrays are taken as they are: float32 or float64, in C order, on the processor, by NumPy or by DLPack. Others raise
`CumuloError`; nothing is copied in silence. Pictures have the shape [views, rows, columns, 4] and the array's precision:
scene-linear red, green and blue with the background, and alpha = 1 - transmittance.
"""

from __future__ import annotations

import dataclasses
import operator
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _native
from .errors import CumuloError
from .fields import Cameras, Function, Lattice, invalid

Array = npt.NDArray[Any]

# Numbers that a camera's derivatives have: position, rotation, focal lengths, principal point.
CAMERA_PARTS = 10
# Numbers of a row of a transfer function.
COLUMNS = {"texture": 4, "piecewise": 5, "gaussians": 6}
# Largest width and height of a picture, in pixels; largest numbers of rays along an edge of a pixel, and of threads.
LARGEST, MOST_RAYS, MOST_THREADS = 65536, 64, 1024


def array(values: Any, what: str = "values") -> Array:
    """An array as it is: float32 or float64, in C order, in the processor's memory.

    Raises `CumuloError` (code "invalid") for anything else, with what to do.
    """

    def wrong(found: str, remedy: str) -> CumuloError:
        return invalid(f"{found}; an array of float32 or float64 in C order is expected", what, remedy)

    if not isinstance(values, np.ndarray):
        if not hasattr(values, "__dlpack__"):
            raise wrong(f"an object of type {type(values).__name__}", "give a NumPy array, or an object with __dlpack__")
        if _elsewhere(values):
            raise wrong(f"an array on another device ({values.device})", "copy it to the processor first: array.cpu()")
        try:
            values = np.from_dlpack(values)
        except (BufferError, RuntimeError, TypeError, ValueError) as error:
            raise wrong(f"an object that DLPack cannot give ({error})", "give array.detach().cpu().contiguous()") from error
    if isinstance(values, np.ma.MaskedArray):
        raise wrong("a masked array", "fill it: array.filled(0)")
    if values.dtype not in (np.float32, np.float64):
        raise wrong(f"an array of {values.dtype}", "convert it: array.astype(numpy.float32)")
    if not values.dtype.isnative:
        raise wrong("an array in the other byte order", "convert it: array.astype(array.dtype.newbyteorder('='))")
    if not values.flags.c_contiguous:
        raise wrong(f"an array of strides {values.strides}", "copy it: numpy.ascontiguousarray(array), or tensor.contiguous()")
    if not values.flags.aligned:
        raise wrong("an array that is not aligned", "copy it: array.copy()")
    found: Array = values
    return found


def _elsewhere(values: Any) -> bool:
    """True for an array that is not in the processor's memory."""
    try:
        return int(getattr(values, "__dlpack_device__", lambda: (1, 0))()[0]) != 1
    except ValueError:
        # PyTorch's tensors without a memory ("meta").
        return True


@dataclasses.dataclass(frozen=True)
class Prepared:
    """An array, arranged for rays, and how it is seen; `values` are the array's."""

    scene: Any
    values: Array

    def render(self) -> Array:
        """The pictures."""
        found: Array = self.scene.render()
        return found


def prepared(values: Any, cameras: Cameras, *, lattice: Lattice | None = None, function: Function | None = None,
             density_scale: float = 1.0, emission: Any = (0.0, 0.0, 0.0), emission_model: str = "grey",
             background: Any = (0.0, 0.0, 0.0), quadrature: str | None = None, step: float | None = None,
             supersample: int = 1, threads: int | None = None) -> Prepared:  # fmt: skip
    """Checks what `render` is given."""
    values = array(values)
    pre_shaded = values.ndim == 4
    native = _cameras(cameras, values.itemsize)
    if lattice is not None and not isinstance(lattice, Lattice):
        raise invalid(f"an object of type {type(lattice).__name__}", "lattice", "give a cumulo.Lattice")
    places = Lattice.box(values.shape[:3]) if lattice is None and values.ndim in (3, 4) else lattice
    if places is None:
        raise invalid(f"an array of shape {values.shape} without a lattice", "values",
                      "give an array [x, y, z], or the lattice of which it holds the values")  # fmt: skip
    expected = places.shape + ((4,) if pre_shaded else ())
    if values.shape != expected:
        raise invalid(f"an array of shape {values.shape} for a lattice of {expected}", "values",
                      "give one value for each voxel; of a pre-shaded volume [x, y, z, 4]")  # fmt: skip
    if pre_shaded and function is not None:
        raise invalid("a transfer function for a pre-shaded volume", "function",
                      "leave it out: the volume has colors and extinctions of its own")  # fmt: skip
    if pre_shaded and number(density_scale, "density_scale") != 1.0:
        raise invalid("a density scale of a pre-shaded volume", "density_scale",
                      "leave it out, and multiply the volume: its four numbers are per world length")  # fmt: skip
    if (pre_shaded or function is not None) and any(triple(emission, "emission")):
        raise invalid("a source beside the colors of a transfer function or a pre-shaded volume", "emission", "leave it out")
    if emission_model not in ("grey", "linear"):
        raise invalid(f"an emission model {emission_model!r}", "emission_model", 'give "grey" or "linear"')
    if quadrature is not None and not isinstance(quadrature, str):
        raise invalid(f"an object of type {type(quadrature).__name__}", "quadrature", 'give a name, such as "exact"')
    medium = _native.Medium(
        number(density_scale, "density_scale"), triple(emission, "emission"), emission_model == "linear",
        None if function is None else (function.kind, rows(function).reshape(-1)),
        (0.0, 1.0) if function is None else tuple(matrix(function.domain, "domain", (2,))), triple(background, "background"),
        quadrature, None if step is None else number(step, "step"),
    )  # fmt: skip
    scene = _native.Scene(
        places._native, values, native, medium, whole(supersample, "supersample", 1, MOST_RAYS),
        whole(threads or 0, "threads", 0, MOST_THREADS), pre_shaded,
    )  # fmt: skip
    return Prepared(scene, values)


def _cameras(cameras: Cameras, bytes_each: int) -> Any:
    """The native module's cameras, after a look at how much memory their pictures take."""
    if not isinstance(cameras, Cameras):
        raise invalid(f"an object of type {type(cameras).__name__}", "cameras", "give cumulo.Cameras")
    if not isinstance(cameras.size, Sequence) or len(cameras.size) != 2:
        raise invalid(f"a size {cameras.size!r}", "size", "give width and height in pixels")
    width, height = (whole(length, "size", 1, LARGEST) for length in cameras.size)
    matrices = matrix(cameras.camera_to_world, "camera_to_world", (None, 4, 4))
    views = len(matrices)
    if views == 0:
        raise invalid("no cameras", "cameras", "give one at least")
    # Pictures are put together from those of the views.
    needed, limit = 8 * bytes_each * views * width * height, _memory()
    if needed > limit:
        raise CumuloError(
            "memory-limit", f"{views} pictures of {width}x{height} pixels need {needed >> 20} MiB, {limit >> 20} MiB are allowed",
            None, "cameras", "render fewer views, or smaller ones, at a time",
        )  # fmt: skip
    return _native.Cameras(
        matrices, matrix(cameras.focal, "focal", (views, 2)), matrix(cameras.centre, "centre", (views, 2)), width, height,
        bool(cameras.orthographic), number(cameras.near, "near"),
    )  # fmt: skip


def _memory() -> int:
    """Bytes that pictures may take: half of the machine's memory, or 4 GiB where its size is unknown."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2
    except (AttributeError, OSError, ValueError):
        return 4 << 30


def matrix(values: Any, what: str = "values", shape: tuple[int | None, ...] | None = None) -> npt.NDArray[np.float64]:
    """Few numbers as float64, copied where they are not; of a shape, in which None stands for any length."""
    try:
        if hasattr(values, "detach"):
            # NumPy has no bfloat16.
            found = values.detach().cpu()
            values = (found if found.is_complex() else found.double()).numpy()
        found = np.asarray(values)
        if found.dtype.kind not in "fiub":
            raise TypeError(f"numbers of {found.dtype}")
        found = np.ascontiguousarray(found, dtype=np.float64)
    except (NotImplementedError, RuntimeError, TypeError, ValueError) as error:
        raise invalid(f"numbers are expected ({error})", what, "give real numbers, in the processor's memory") from error
    if shape is not None and (found.ndim != len(shape) or any(n not in (None, m) for n, m in zip(shape, found.shape))):
        wanted = ", ".join("views" if n is None else str(n) for n in shape)
        raise invalid(f"an array of shape {np.shape(values)}; [{wanted}] is expected", what, "give an array of that shape")
    return found


def number(value: Any, what: str) -> float:
    """One number."""
    found = matrix(value, what)
    if found.size != 1:
        raise invalid(f"{found.size} numbers", what, "give one number, or a tensor of one")
    return float(found.reshape(()))


def whole(value: Any, what: str, least: int, most: int) -> int:
    """A whole number between bounds."""
    try:
        found = operator.index(value)
    except TypeError as error:
        raise invalid(f"{value!r} is no whole number", what, f"give one from {least} to {most}") from error
    if not least <= found <= most:
        raise invalid(f"{found} is out of bounds", what, f"give a whole number from {least} to {most}")
    return found


def kind(function: Function) -> str:
    """The kind of a transfer function."""
    found: str | None = getattr(function, "kind", None)
    if found not in COLUMNS:
        raise invalid(f"an object of type {type(function).__name__}", "function",
                      "give a cumulo.Texture, cumulo.Piecewise or cumulo.Gaussians")  # fmt: skip
    return found


def rows(function: Function) -> npt.NDArray[np.float64]:
    """The parameters of a transfer function, a row an entry."""
    columns = COLUMNS[kind(function)]
    found = matrix(function.parameters, "function")
    if found.ndim != 2 or found.shape[1] != columns or len(found) == 0:
        raise invalid(f"an array of shape {found.shape} for a {function.kind} function", "function",
                      f"give an array [n, {columns}] of one entry or more")  # fmt: skip
    return found


def triple(values: Any, what: str) -> list[float]:
    """Red, green and blue."""
    found = matrix(values, what).reshape(-1)
    if found.shape != (3,):
        raise invalid(f"{found.size} numbers of a color", what, "give red, green and blue")
    return [float(v) for v in found]


def render(values: Any, cameras: Cameras, *, lattice: Lattice | None = None, function: Function | None = None,
           density_scale: float = 1.0, emission: Any = (0.0, 0.0, 0.0), emission_model: str = "grey",
           background: Any = (0.0, 0.0, 0.0), quadrature: str | None = None, step: float | None = None,
           supersample: int = 1, threads: int | None = None) -> Array:  # fmt: skip
    """Renders an array: pictures [views, rows, columns, 4] in its precision. float32 gives the bits of `cumulo.render`.

    `values`: densities [x, y, z], those of a grid's active voxels [voxels] with their `lattice`, or a pre-shaded volume
    [x, y, z, 4]. `lattice`: places of the values (default: voxels of size 1 around the world's origin). `function`:
    color and extinction by density; without it the extinction is `density_scale` times the density, which must not be
    negative, and the source has the radiance `emission`, times the density with the `emission_model` "linear".
    `background`: radiance behind the volume. `quadrature` and `step` (in voxels): as in `cumulo render --help`.
    `supersample`: rays along each edge of a pixel. `threads`: default all cores; results do not depend on it.

    Raises `CumuloError`, and KeyboardInterrupt within a second of Ctrl-C.
    """
    return prepared(
        values, cameras, lattice=lattice, function=function, density_scale=density_scale, emission=emission,
        emission_model=emission_model, background=background, quadrature=quadrature, step=step, supersample=supersample,
        threads=threads,
    ).render()  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Gradient:
    """Derivatives of a loss: with respect to the values (of their shape), the parameters of the function (of theirs),
    the cameras, density scale, emission, background and step.

    `cameras`: [views, 10], position in world units, rotation vector about world axes through the position in radians,
    focal lengths along x and y, principal point. What was not asked for is None.
    """

    values: Array | None
    function: Array | None
    cameras: Array | None
    density_scale: float
    emission: Array
    background: Array
    step: float | None


def gradient(by_pictures: Any, values: Any, cameras: Cameras, *, wrt: tuple[str, ...] = ("values",), **settings: Any) -> Gradient:
    """Derivatives of a loss from those with respect to the pictures, `by_pictures` [views, rows, columns, 4].

    `wrt` names what is computed: "values", "function", "cameras" (with the step of a quadrature); the others cost
    nothing. `settings` are those of `render`. Derivatives with respect to float32 pictures are float32.
    """
    unknown = set(wrt) - {"values", "function", "cameras"}
    if unknown:
        raise invalid(f"derivatives with respect to {sorted(unknown)}", "wrt", 'give some of "values", "function", "cameras"')
    given = prepared(values, cameras, **settings)
    function = settings.get("function")
    found = vjp(given, array(by_pictures, "by_pictures"), [name in wrt for name in ("values", "function", "cameras")])
    return Gradient(
        found["values"].reshape(given.values.shape) if "values" in wrt else None,
        found["function"].reshape(rows(function).shape) if "function" in wrt and function else None,
        found["cameras"] if "cameras" in wrt else None,
        found["extinction"], np.array(found["emission"]), np.array(found["background"]),
        found["step"] if "cameras" in wrt else None,
    )  # fmt: skip


def vjp(given: Prepared, by_pictures: Array, wanted: list[bool]) -> dict[str, Any]:
    """The native module's derivatives."""
    if by_pictures.dtype != given.values.dtype:
        raise invalid(f"derivatives of {by_pictures.dtype} for pictures of {given.values.dtype}", "by_pictures",
                      "convert them to the precision of the values")  # fmt: skip
    if not np.isfinite(by_pictures).all():
        raise invalid("derivatives that are not finite", "by_pictures",
                      "look for a division by zero, or a logarithm of zero, in the loss")  # fmt: skip
    found: dict[str, Any] = given.scene.vjp(by_pictures, *wanted)
    return found


def camera_changes(of: Mapping[str, Any], matrices: Array) -> Array | None:
    """Changes of cameras, [views, 10], from those of `camera_to_world`, `focal` and `centre`, of which None is no change."""
    if of["camera_to_world"] is None and of["focal"] is None and of["centre"] is None:
        return None
    change = np.zeros((len(matrices), CAMERA_PARTS))
    if of["camera_to_world"] is not None:
        moved = matrix(of["camera_to_world"])
        change[:, :3] = moved[:, :3, 3]
        turned = (moved[:, :3, :3] / _lengths(matrices) ** 2) @ matrices[:, :3, :3].transpose(0, 2, 1)
        change[:, 3:6] = 0.5 * np.stack([turned[:, a, b] - turned[:, b, a] for a, b in ((2, 1), (0, 2), (1, 0))], -1)
    for name, at in (("focal", 6), ("centre", 8)):
        if of[name] is not None:
            change[:, at : at + 2] = matrix(of[name])
    return change


def by_matrices(by: Array, matrices: Array) -> Array:
    """Derivatives with respect to matrices, [views, 4, 4], from those with respect to positions and rotations: the
    transpose of `camera_changes`."""
    x, y, z = by[:, 3:6].T
    zero = np.zeros_like(x)
    cross = np.stack([np.stack(row, -1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))], -2)
    found = np.zeros_like(matrices)
    found[:, :3, :3] = 0.5 * cross @ matrices[:, :3, :3] / _lengths(matrices) ** 2
    found[:, :3, 3] = by[:, :3]
    return found


def _lengths(matrices: Array) -> Array:
    """Lengths of a camera's axes, [views, 1, 3], which pictures do not depend on."""
    found: Array = np.linalg.norm(matrices[:, :3, :3], axis=1, keepdims=True)
    return found
