"""Pictures as an operation of PyTorch.

    lattice = Lattice.box(density.shape, voxel_size=0.1)
    picture = cumulo.torch.render(density, cameras, lattice=lattice, density_scale=2.0)
    (picture[..., 3] - target).square().mean().backward()

Whatever of the arguments requires a gradient gets one: densities or pre-shaded colors, the transfer function, cameras,
density scale, emission, background and the quadrature's step; nothing else is computed. Rays are walked again in the
backward pass, so that the memory does not depend on their number, nor on that of samples along them (Weiss & Westermann
2021, section 4); the volume is kept once more, as kernels arrange it. `torch.func.jvp` gives derivatives in forward mode. There are no second derivatives.
"""

from __future__ import annotations

import ctypes
import functools
import math
import pathlib
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor

from . import pictures
from .fields import Cameras, Function, Gaussians, Lattice, Piecewise, Texture, invalid

__all__ = ["Cameras", "Gaussians", "Lattice", "Piecewise", "Texture", "look_at", "render"]

# Places of the arguments of `Render.forward` that are tensors or None, behind the settings.
INPUTS = ("values", "function", "camera_to_world", "focal", "centre", "density_scale", "emission", "background", "step")


def render(values: Tensor, cameras: Cameras, *, lattice: Lattice | None = None, function: Function | None = None,
           density_scale: float | Tensor = 1.0, emission: Any = (0.0, 0.0, 0.0), emission_model: str = "grey",
           background: Any = (0.0, 0.0, 0.0), quadrature: str | None = None, step: float | Tensor | None = None,
           supersample: int = 1, threads: int | None = None) -> Tensor:  # fmt: skip
    """Renders a tensor: pictures [views, rows, columns, 4] in its precision (float32 or float64).

    Arguments are those of `cumulo.pictures.render`; tensors among them may require a gradient: `values`, the parameters
    of `function`, the `camera_to_world`, `focal` and `centre` of `cameras`, `density_scale`, `emission`, `background`
    and `step`. Colors are rounded to float32. The derivative with respect to `camera_to_world` is that along rigid
    motions: of matrices that are made by rotations and translations, such as those of `look_at`, it is exact.

    Raises `CumuloError` for tensors on another device, of another type, or not in C order (`tensor.contiguous()`).
    """
    if not isinstance(values, Tensor):
        raise invalid(f"an object of type {type(values).__name__}; a tensor is expected", "values",
                      "give a torch.Tensor, or call cumulo.pictures.render")  # fmt: skip
    if not isinstance(cameras, Cameras):
        raise invalid(f"an object of type {type(cameras).__name__}", "cameras", "give cumulo.Cameras")
    if function is not None:
        pictures.kind(function)
    settings = {
        "lattice": lattice, "emission_model": emission_model, "quadrature": quadrature, "supersample": supersample,
        "threads": threads, "size": cameras.size, "orthographic": cameras.orthographic, "near": cameras.near,
        "kind": None if function is None else type(function),
        "domain": None if function is None else function.domain,
    }  # fmt: skip
    return Render.apply(
        settings, values, None if function is None else _tensor(function.parameters, "function"),
        *(_tensor(getattr(cameras, name), name) for name in INPUTS[2:5]), _tensor(density_scale, "density_scale"),
        _tensor(emission, "emission"), _tensor(background, "background"), None if step is None else _tensor(step, "step"),
    )  # fmt: skip


def _tensor(value: Any, what: str) -> Tensor:
    """A number or an array as a tensor; tensors as they are."""
    return value if isinstance(value, Tensor) else torch.from_numpy(pictures.matrix(value, what))


def look_at(eye: Tensor, target: Any = (0.0, 0.0, 0.0), up: Any = (0.0, 0.0, 1.0)) -> Tensor:
    """Camera-to-world matrices [..., 4, 4] of cameras at `eye` [..., 3] that look at `target`, with derivatives."""
    if not isinstance(eye, Tensor):
        raise invalid(f"an object of type {type(eye).__name__}; a tensor is expected", "eye", "give torch.tensor(eye)")
    target, up = (torch.as_tensor(v, dtype=eye.dtype).expand(eye.shape) for v in (target, up))
    back = torch.nn.functional.normalize(eye - target, dim=-1)
    right = torch.nn.functional.normalize(torch.linalg.cross(up, back), dim=-1)
    columns = torch.stack([right, torch.linalg.cross(back, right), back, eye], dim=-1)
    last = torch.tensor([0.0, 0.0, 0.0, 1.0], dtype=eye.dtype).expand(*eye.shape[:-1], 1, 4)
    return torch.cat([columns, last], dim=-2)


# Pixels from which on the work is worth that PyTorch's threads start anew.
MANY = 4096
# OpenMP's omp_pause_soft.
SOFT = 1


@functools.cache
def _pause() -> Callable[[int], int] | None:
    """OpenMP's function by which threads without work end, as PyTorch has it."""
    try:
        library = ctypes.CDLL(str(pathlib.Path(torch.__file__).with_name("lib") / "libtorch_cpu.so"))
        found: Callable[[int], int] = library.omp_pause_resource_all
    except (OSError, AttributeError):
        return None
    return found


def _prepared(settings: dict[str, Any], inputs: tuple[Tensor | None, ...]) -> pictures.Prepared:
    """The array, arranged for rays: once for the pictures and their derivatives."""
    if "prepared" not in settings:
        settings["prepared"] = _arranged(settings, inputs)
    found: pictures.Prepared = settings["prepared"]
    assert inputs[2] is not None
    if len(inputs[2]) * math.prod(settings["size"]) >= MANY and (pause := _pause()) is not None:
        # After an operation PyTorch's threads wait for the next one for milliseconds, at full load.
        pause(SOFT)
    return found


def _arranged(settings: dict[str, Any], inputs: tuple[Tensor | None, ...]) -> pictures.Prepared:
    """The array as it is seen."""
    values, function, camera_to_world, focal, centre, density_scale, emission, background, step = inputs
    assert values is not None
    if values.is_neg():
        raise invalid("a tensor whose sign is yet to be turned", "values", "turn it: tensor.resolve_neg()")
    made = None
    if function is not None:
        kind, parameters = settings["kind"], pictures.matrix(function)
        made = kind(parameters) if kind is Piecewise else kind(parameters, settings["domain"])
    cameras = Cameras(camera_to_world, focal, centre, settings["size"], settings["orthographic"], settings["near"])
    names = ("lattice", "emission_model", "quadrature", "supersample", "threads")
    return pictures.prepared(
        values.detach(), cameras, function=made, density_scale=density_scale, emission=emission,
        background=background, step=step, **{name: settings[name] for name in names},
    )  # fmt: skip


class Render(torch.autograd.Function):
    """Pictures; what they depend on is named by `INPUTS`."""

    @staticmethod
    def forward(settings: dict[str, Any], *inputs: Tensor | None) -> Tensor:  # type: ignore[override]
        """The pictures."""
        return torch.from_numpy(_prepared(settings, inputs).render())

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:
        """Keeps what the derivatives depend on: no pictures, no samples."""
        ctx.settings, *tensors = inputs
        ctx.save_for_backward(*tensors)
        ctx.save_for_forward(*tensors)

    @staticmethod
    def backward(ctx: Any, by_pictures: Tensor) -> tuple[Tensor | None, ...]:  # type: ignore[override]
        """Derivatives of a loss from those with respect to the pictures."""
        return (None, *Backward.apply(ctx.settings, ctx.needs_input_grad[1:], by_pictures, *ctx.saved_tensors))

    @staticmethod
    def jvp(ctx: Any, _: None, *tangents: Tensor | None) -> Tensor:  # type: ignore[override]
        """Change of the pictures from those of the inputs."""
        return Forward.apply(ctx.settings, *ctx.saved_tensors, *tangents)


class Derivatives(torch.autograd.Function):
    """Derivatives of pictures, whose own derivatives are refused by name.

    They are functions of their own because `torch.func` gives these, and no others, tensors that have a storage.
    """

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Any) -> None:
        """Keeps nothing."""

    @staticmethod
    def backward(ctx: Any, *_: Any) -> Any:
        """Refuses."""
        raise NotImplementedError(
            "cumulo.torch.render has no second derivatives: call backward without create_graph, or take difference"
            " quotients of the first derivatives"
        )

    @staticmethod
    def jvp(ctx: Any, *_: Any) -> Any:
        """Refuses."""
        raise NotImplementedError(
            "cumulo.torch.render has no second derivatives: take difference quotients of the first derivatives"
        )


class Forward(Derivatives):
    """Change of pictures."""

    @staticmethod
    def forward(settings: dict[str, Any], *tensors: Tensor | None) -> Tensor:  # type: ignore[override]
        """The change of the pictures from inputs and their changes."""
        inputs, tangents = tensors[: len(INPUTS)], tensors[len(INPUTS) :]
        given = _prepared(settings, inputs)
        of = dict(zip(INPUTS, tangents))

        def numbers(name: str, zero: Any) -> Any:
            return zero if of[name] is None else pictures.matrix(of[name]).reshape(-1)

        values, function = of["values"], of["function"]
        found = given.scene.jvp(
            None if values is None else pictures.array(values.detach().contiguous(), "tangent of values"),
            None if function is None else pictures.matrix(function).reshape(-1),
            pictures.camera_changes(of, pictures.matrix(inputs[2])),
            float(numbers("step", [0.0])[0]), float(numbers("density_scale", [0.0])[0]),
            list(numbers("emission", [0.0] * 3)), list(numbers("background", [0.0] * 3)),
        )  # fmt: skip
        assert inputs[0] is not None
        return torch.from_numpy(found).to(inputs[0].dtype)


class Backward(Derivatives):
    """Derivatives of a loss."""

    @staticmethod
    def forward(settings: dict[str, Any], needed: tuple[bool, ...], by_pictures: Tensor,
                *inputs: Tensor | None) -> tuple[Tensor | None, ...]:  # type: ignore[override]  # fmt: skip
        """The derivatives that are needed."""
        wants = dict(zip(INPUTS, needed))
        rays = any(wants[name] for name in ("camera_to_world", "focal", "centre", "step"))
        if not torch.isfinite(by_pictures).all():
            # A loss that is not a number has no derivatives that are.
            nothing = [torch.full_like(t, float("nan")) if t is not None and n else None for t, n in zip(inputs, needed)]
            return tuple(nothing)
        given = _prepared(settings, inputs)
        found = pictures.vjp(given, by_pictures.detach().contiguous().numpy(), [wants["values"], wants["function"], rays])
        by, matrices = found["cameras"], pictures.matrix(inputs[2])
        all_of = {
            "values": lambda: found["values"], "function": lambda: found["function"],
            "camera_to_world": lambda: pictures.by_matrices(by, matrices), "focal": lambda: by[:, 6:8], "centre": lambda: by[:, 8:10],
            "density_scale": lambda: np.array(found["extinction"]), "emission": lambda: np.array(found["emission"]),
            "background": lambda: np.array(found["background"]), "step": lambda: np.array(found["step"]),
        }  # fmt: skip

        def one(name: str, tensor: Tensor | None) -> Tensor | None:
            if tensor is None or not wants[name]:
                return None
            return torch.from_numpy(np.ascontiguousarray(all_of[name]())).to(tensor.dtype).reshape(tensor.shape)

        return tuple(one(name, tensor) for name, tensor in zip(INPUTS, inputs))
