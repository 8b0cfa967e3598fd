"""Use cases of Cumulo, and pictures of arrays with their derivatives."""

import os
from collections.abc import Callable, Sequence
from typing import Any, final

import numpy as np
import numpy.typing as npt

__all__ = ["Cameras", "Lattice", "Medium", "Scene", "__version__", "main", "read_volume", "run", "set_helper"]

__version__: str

_Path = str | os.PathLike[str]
_Rows = Sequence[Sequence[float]]

def run(words: Sequence[_Path], progress: Callable[[str], None] | None = None, threads: int = 0) -> tuple[str, int]: ...
def main(words: Sequence[_Path]) -> int: ...
def set_helper(program: _Path, words: Sequence[_Path]) -> None: ...
def read_volume(
    path: _Path, grid: str | None = None, max_memory: int | None = None
) -> tuple[npt.NDArray[np.float32], list[list[float]], str, list[int], list[float]]: ...
@final
class Lattice:
    @staticmethod
    def of_box(shape: Sequence[int], transform: _Rows, max_memory: int | None = None) -> Lattice: ...
    @staticmethod
    def of_grid(
        path: _Path, grid: str | None = None, max_memory: int | None = None
    ) -> tuple[Lattice, npt.NDArray[np.float32]]: ...
    @property
    def shape(self) -> list[int]: ...
    @property
    def transform(self) -> list[list[float]]: ...
    def coordinates(self) -> npt.NDArray[np.int32]: ...

@final
class Cameras:
    def __new__(
        cls,
        camera_to_world: npt.NDArray[np.float64],
        focal: npt.NDArray[np.float64],
        centre: npt.NDArray[np.float64],
        width: int,
        height: int,
        orthographic: bool = False,
        near: float = 0.0,
    ) -> Cameras: ...
    def __len__(self) -> int: ...

@final
class Medium:
    def __new__(
        cls,
        extinction: float = 1.0,
        emission: Sequence[float] = ...,
        linear: bool = False,
        function: tuple[str, npt.NDArray[np.float64]] | None = None,
        domain: Sequence[float] = ...,
        background: Sequence[float] = ...,
        quadrature: str | None = None,
        step: float | None = None,
    ) -> Medium: ...

@final
class Scene:
    def __new__(
        cls,
        lattice: Lattice,
        values: npt.NDArray[Any],
        cameras: Cameras,
        medium: Medium,
        rays_per_edge: int = 1,
        threads: int = 0,
        pre_shaded: bool = False,
    ) -> Scene: ...
    def render(self) -> npt.NDArray[Any]: ...
    def vjp(
        self,
        cotangents: npt.NDArray[Any],
        by_values: bool = True,
        by_function: bool = True,
        by_rays: bool = True,
    ) -> dict[str, Any]: ...
    def jvp(
        self,
        by_values: npt.NDArray[Any] | None = None,
        by_function: npt.NDArray[np.float64] | None = None,
        by_cameras: npt.NDArray[np.float64] | None = None,
        step: float = 0.0,
        extinction: float = 0.0,
        emission: Sequence[float] = ...,
        background: Sequence[float] = ...,
    ) -> npt.NDArray[np.float64]: ...
