"""Pictures as a function of JAX.

    picture = cumulo.jax.render(density, cameras, lattice=lattice, density_scale=2.0)
    jax.grad(lambda density: my_loss(cumulo.jax.render(density, cameras, lattice=lattice)))(density)

`jax.grad`, `jax.vjp` and `jax.jit` work, on the processor; there is no forward mode and no second derivative. Arrays are
float32 unless JAX is told to take 64 bits (`jax_enable_x64`).
"""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from . import pictures
from .errors import CumuloError
from .fields import Cameras, Function, Lattice, Piecewise


def render(values: Any, cameras: Cameras, *, lattice: Lattice | None = None, function: Function | None = None,
           density_scale: Any = 1.0, emission: Any = (0.0, 0.0, 0.0), emission_model: str = "grey",
           background: Any = (0.0, 0.0, 0.0), quadrature: str | None = None, supersample: int = 1,
           threads: int | None = None) -> jax.Array:  # fmt: skip
    """Renders an array: pictures [views, rows, columns, 4] in its precision, with derivatives in reverse mode.

    Arguments are those of `cumulo.pictures.render`; derivatives are with respect to `values`, the parameters of
    `function`, the `camera_to_world` (along rigid motions), `focal` and `centre` of `cameras`, `density_scale`,
    `emission` and `background`.
    """
    parameters = None if function is None else function.parameters
    inputs = {
        name: None if value is None else jax.numpy.asarray(value)
        for name, value in {
            "values": values, "function": parameters, "camera_to_world": cameras.camera_to_world, "focal": cameras.focal,
            "centre": cameras.centre, "density_scale": density_scale, "emission": emission, "background": background,
        }.items()
    }  # fmt: skip
    settings = {"lattice": lattice, "emission_model": emission_model, "quadrature": quadrature, "supersample": supersample,
                "threads": threads}  # fmt: skip

    def prepared(given: dict[str, Any]) -> pictures.Prepared:
        given = {name: None if value is None else np.asarray(value) for name, value in given.items()}
        kind, made = type(function), None
        if function is not None:
            made = kind(given["function"]) if kind is Piecewise else kind(given["function"], function.domain)
        seen = Cameras(
            given["camera_to_world"], given["focal"], given["centre"], cameras.size, cameras.orthographic, cameras.near
        )
        colors = {name: given[name] for name in ("emission", "background")}
        return pictures.prepared(
            np.ascontiguousarray(given["values"]), seen, function=made, density_scale=float(given["density_scale"]),
            **colors, **settings,
        )  # fmt: skip

    def pull(given: dict[str, Any], by_pictures: Any) -> dict[str, Any]:
        by = np.ascontiguousarray(by_pictures)
        if not np.isfinite(by).all():
            # A loss that is not a number has no derivatives that are.
            return {name: None if v is None else np.full(v.shape, np.nan, v.dtype) for name, v in given.items()}
        found = pictures.vjp(prepared(given), by, [True, function is not None, True])
        cameras_by = found["cameras"]
        of = {
            "values": found["values"], "function": found["function"],
            "camera_to_world": pictures.by_matrices(cameras_by, pictures.matrix(given["camera_to_world"])),
            "focal": cameras_by[:, 6:8], "centre": cameras_by[:, 8:10], "density_scale": found["extinction"],
            "emission": found["emission"], "background": found["background"],
        }  # fmt: skip
        return {n: None if v is None else np.asarray(of[n], v.dtype).reshape(v.shape) for n, v in given.items()}

    if inputs["values"].dtype not in (np.float32, np.float64):
        raise CumuloError("invalid", f"an array of {inputs['values'].dtype}; float32 or float64 is expected", None, "values",
                          "convert it: array.astype(jax.numpy.float32)")  # fmt: skip
    width, height = cameras.size
    shape = jax.ShapeDtypeStruct((inputs["camera_to_world"].shape[0], height, width, 4), inputs["values"].dtype)
    like = {n: None if v is None else jax.ShapeDtypeStruct(v.shape, v.dtype) for n, v in inputs.items()}

    @jax.custom_vjp
    def picture(given: dict[str, Any]) -> jax.Array:
        found: jax.Array = jax.pure_callback(lambda g: prepared(g).render(), shape, given, vmap_method="sequential")
        return found

    picture.defvjp(
        lambda given: (picture(given), given),
        lambda given, by: (jax.pure_callback(pull, like, given, by, vmap_method="sequential"),),
    )
    found: jax.Array = picture(inputs)
    return found
