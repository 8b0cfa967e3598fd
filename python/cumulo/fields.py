"""What arrays of voxels stand for: where their values lie, through which function they are seen, and from where.

An array of a box has the shape [x, y, z], and its entry [i, j, k] is the value at the centre of a voxel. A pre-shaded
volume has the shape [x, y, z, 4]: the radiance emitted per world length in red, green and blue, and the extinction.
"""

from __future__ import annotations

import dataclasses
import math
import os
import operator
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

from . import _native
from .errors import CumuloError
from .options import Path

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from .capture import Camera


def invalid(what: str, part: str | None, remedy: str) -> CumuloError:
    """The exception of an argument that cannot be used."""
    return CumuloError("invalid", what, None, part, remedy)


class Lattice:
    """Places of the values of an array: all voxels of a box (`Lattice.box`), or the active voxels of a grid
    (`Lattice.read`), whose array has one axis.

    `shape` is that of arrays of densities, `transform` the map from indices, those of voxel centres, to the world: four
    rows of four numbers, acting on columns.
    """

    def __init__(self, native: Any, made_of: tuple[Any, ...]) -> None:
        self._native = native
        self._made_of = made_of

    def __reduce__(self) -> tuple[Any, ...]:
        return _made_again, self._made_of

    @classmethod
    def box(cls, shape: Sequence[int], *, voxel_size: float | None = None,
            origin: Sequence[float] | None = None, transform: npt.ArrayLike | None = None,
            max_memory: int | None = None) -> Lattice:  # fmt: skip
        """Places of an array of the shape (x, y, z).

        Give `voxel_size` (world units, default 1), and with it `origin`, the world position of the centre of voxel
        [0, 0, 0] (default: the box is centred at the world's origin); or `transform`, [4, 4]. `max_memory` bounds the
        memory in bytes that a call may take (default: half of the machine's). Raises `CumuloError`.
        """
        try:
            numbers = tuple(operator.index(n) for n in shape[:3])
        except TypeError:
            numbers = ()
        if len(numbers) < 3 or not all(0 <= n < 2**63 for n in numbers):
            raise invalid(f"an array of shape {shape!r}", "shape", "give the lengths of three axes, x, y and z")
        if transform is None:
            size = 1.0 if voxel_size is None else float(voxel_size)
            at = [-0.5 * size * (n - 1) for n in numbers] if origin is None else [float(v) for v in origin]
            if len(at) != 3:
                raise invalid(f"{len(at)} numbers", "origin", "give the world position of the centre of voxel [0, 0, 0]")
            rows = [[size if r == c else 0.0 for c in range(3)] + [at[r]] for r in range(3)] + [[0.0, 0.0, 0.0, 1.0]]
        else:
            if voxel_size is not None or origin is not None:
                raise TypeError("give transform, or voxel_size and origin, not both")
            import numpy

            rows = numpy.asarray(transform, dtype=numpy.float64).tolist()
            if numpy.shape(rows) != (4, 4):
                raise invalid(f"{len(rows)} rows", "transform", "give four rows of four numbers")
        return cls(_native.Lattice.of_box(numbers, rows, max_memory), (numbers, rows, max_memory))

    @classmethod
    def read(cls, path: Path, grid: str | None = None, *,
             max_memory: int | None = None) -> tuple[Lattice, npt.NDArray[np.float32]]:  # fmt: skip
        """The active voxels of a grid of a file: their places and their values, float32, [voxels]. All other voxels,
        and the background, keep the file's values. Raises `CumuloError` if the file cannot be read as a density."""
        native, values = _native.Lattice.of_grid(os.fsdecode(path), grid, max_memory)
        return cls(native, (os.path.abspath(os.fsdecode(path)), grid, max_memory)), values

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of arrays of densities."""
        return tuple(self._native.shape)

    @property
    def transform(self) -> npt.NDArray[np.float64]:
        """Map from indices to the world, [4, 4]."""
        import numpy

        return numpy.array(self._native.transform)

    def coordinates(self) -> npt.NDArray[np.int32]:
        """Index coordinates of a grid's active voxels, [voxels, 3]. Raises `CumuloError` for a box."""
        found: npt.NDArray[np.int32] = self._native.coordinates()
        return found


def _made_again(place: Any, how: Any, max_memory: int | None) -> Lattice:
    """A lattice of its pickle: of a box by its shape and transform, of a grid by its file, which is read again."""
    if isinstance(place, str):
        return Lattice.read(place, how, max_memory=max_memory)[0]
    return Lattice.box(place, transform=how, max_memory=max_memory)


@dataclasses.dataclass(frozen=True, eq=False)
class Texture:
    """A transfer function of `texels`, [n, 4], evenly over the `domain` of densities: texel i lies at
    low + (i + 1/2) (high - low) / n. It is linear between texels and constant outside the outermost. Columns are the
    radiance of the source in red, green and blue, and the extinction per world unit at a density scale of 1."""

    texels: Any
    domain: tuple[float, float] = (0.0, 1.0)
    kind: Literal["texture"] = dataclasses.field(default="texture", init=False)

    @property
    def parameters(self) -> Any:
        """The array that pictures depend on."""
        return self.texels


@dataclasses.dataclass(frozen=True, eq=False)
class Piecewise:
    """A transfer function that is linear between `points`, [n, 5], of ascending density: density, red, green, blue and
    extinction. Two points of one density are a step."""

    points: Any
    kind: Literal["piecewise"] = dataclasses.field(default="piecewise", init=False)

    @property
    def parameters(self) -> Any:
        """The array that pictures depend on."""
        return self.points

    @property
    def domain(self) -> tuple[float, float]:
        """Points name their densities themselves."""
        return (0.0, 1.0)


@dataclasses.dataclass(frozen=True, eq=False)
class Gaussians:
    """A transfer function that is a sum of `lobes`, [n, 6]: density of the peak, logarithm of the standard deviation,
    then red, green, blue and extinction at the peak. It is tabulated over the `domain` and constant outside."""

    lobes: Any
    domain: tuple[float, float] = (0.0, 1.0)
    kind: Literal["gaussians"] = dataclasses.field(default="gaussians", init=False)

    @property
    def parameters(self) -> Any:
        """The array that pictures depend on."""
        return self.lobes


Function = Texture | Piecewise | Gaussians


@dataclasses.dataclass(frozen=True, eq=False)
class Cameras:
    """Cameras whose pictures have one size.

    `camera_to_world`: [views, 4, 4], rigid motions acting on columns; a camera looks down its -Z with +Y up. `focal`:
    [views, 2], focal lengths along x and y in pixels (of orthographic cameras in pixels per world unit). `centre`:
    [views, 2], principal points in pixels from the top left corner. `size`: (width, height) in pixels. `near`: distance
    along the viewing axis before which nothing is seen, in world units. Arrays are NumPy's or, for derivatives with
    respect to them, tensors.
    """

    camera_to_world: Any
    focal: Any
    centre: Any
    size: tuple[int, int]
    orthographic: bool = False
    near: float = 0.0

    @classmethod
    def of(cls, cameras: Sequence[Camera]) -> Cameras:
        """The cameras of a capture, such as those of `Capture.read(path).frames`. Raises ValueError where their
        pictures, projections or near distances differ, since one call has one of each."""
        import numpy

        if not cameras:
            raise ValueError("no cameras; one view at least is needed")
        alike = {(c.width, c.height, c.orthographic, c.near or 0.0) for c in cameras}
        if len(alike) > 1:
            raise ValueError(f"cameras of {len(alike)} kinds {sorted(alike)}; call once for each size, projection and near")
        [(width, height, orthographic, near)] = alike
        return cls(
            numpy.stack([c.camera_to_world for c in cameras]),
            numpy.array([(c.fl_x, c.fl_y) for c in cameras]),
            numpy.array([(c.cx, c.cy) for c in cameras]),
            (width, height),
            orthographic,
            near,
        )

    @classmethod
    def around(cls, lattice: Lattice, views: int, size: tuple[int, int], *, field_of_view: float = 40.0) -> Cameras:
        """`views` perspective cameras on a sphere around the whole box of a lattice; `field_of_view` is that of the
        picture's longer side in degrees."""
        import numpy

        from .capture import sphere_cameras

        if not 0 < field_of_view < 180:
            raise invalid(f"{field_of_view} degrees", "field_of_view", "give an angle between 0 and 180")

        if len(lattice.shape) == 3:
            low, high = numpy.zeros(3), numpy.array(lattice.shape) - 1.0
        else:
            at = lattice.coordinates()
            low, high = at.min(0).astype(float), at.max(0).astype(float)
        corners = numpy.array([[(low, high)[i >> a & 1][a] for a in range(3)] for i in range(8)])
        world = corners @ lattice.transform[:3, :3].T + lattice.transform[:3, 3]
        return cls.of(sphere_cameras(views, world.min(0), world.max(0), *size, math.radians(field_of_view)))
