"""Derivatives with respect to everything that pictures depend on agree with difference quotients in double precision, in
reverse and in forward mode."""

import dataclasses

import cases
import cumulo.torch as ct
import pytest
import torch
from cumulo.fields import Gaussians, Piecewise, Texture
from torch.autograd import gradcheck

KINDS = [Texture, Piecewise, Gaussians]
LOOK = {"density_scale": 1.3, "emission": (0.5, 0.25, 1.0), "background": (0.25, 0.5, 0.75)}
COLOR_STEP = 2.0**-8


def agrees(picture, *inputs, fast=True, **options):
    """Checks both modes of differentiation of a function of tensors: the whole Jacobian, or, which is `fast`, its product
    with random vectors."""
    inputs = [value.clone().requires_grad_() for value in inputs]
    assert picture(*inputs).std() > 0.01, "a picture that shows something"
    return gradcheck(picture, inputs, check_forward_ad=True, fast_mode=fast, **options)


def through(kind, **options):
    """Settings of pictures through a transfer function."""
    return {"lattice": cases.lattice(), "density_scale": 0.8, "background": (0.3, 0.1, 0.2), **options,
            "function": cases.function(kind)}  # fmt: skip


@pytest.mark.parametrize("model", ["grey", "linear"])
@pytest.mark.parametrize("quadrature", [None, "exact", "preintegrated", "midpoint:0.7", "riemann:0.7"])
def test_densities(model, quadrature):
    def picture(values):
        return ct.render(values, cases.cameras(), lattice=cases.lattice(), emission_model=model, quadrature=quadrature, **LOOK)

    assert agrees(picture, cases.density(), fast=quadrature is not None)


@pytest.mark.parametrize("quadrature", [None, "exact", "preintegrated:0.001", "midpoint:0.7", "riemann:0.7"])
@pytest.mark.parametrize("kind", KINDS)
def test_densities_through_a_function_and_the_function(kind, quadrature):
    settings = through(kind, quadrature=quadrature)

    def picture(values, parameters):
        return ct.render(values, cases.cameras(), **{**settings, "function": kind(parameters)})

    # Extinction at exactly 0 or 1 of a domain is a kink; none of these lies there.
    assert agrees(picture, cases.density(), settings["function"].parameters)


@pytest.mark.parametrize("kind", [None, *KINDS])
def test_active_voxels_of_a_grid(kind, tmp_path):
    places, values = cases.sparse(tmp_path)
    assert 8 < len(values) < 50
    settings = {"function": cases.function(kind)} if kind else LOOK

    def picture(values):
        return ct.render(values, cases.cameras(), lattice=places, **settings)

    assert agrees(picture, torch.from_numpy(values).double())


@pytest.mark.parametrize("quadrature", [None, "midpoint:0.7"])
def test_pre_shaded_volumes(quadrature):
    def picture(values):
        return ct.render(
            values, cases.cameras(), lattice=cases.lattice(), background=(0.25, 0.5, 0.75), quadrature=quadrature
        )

    assert agrees(picture, cases.pre_shaded())


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("kind", [None, *KINDS])
@pytest.mark.parametrize("quadrature", [None, "preintegrated", "midpoint:0.7"])
def test_cameras(quadrature, kind, orthographic):
    seen, values = cases.cameras(orthographic=orthographic), cases.density()
    settings = through(kind) if kind else {"lattice": cases.lattice(), **LOOK}

    def picture(turns, shifts, focal, centre):
        moved = dataclasses.replace(cases.moved(seen, turns, shifts), focal=focal, centre=centre)
        return ct.render(values, moved, quadrature=quadrature, **settings)

    motions = [0.1 * cases.random(2, 3, seed=seed, low=-1) for seed in (3, 4)]
    assert agrees(picture, *motions, seen.focal, seen.centre, fast=quadrature is not None)


def test_matrices_of_other_lengths_are_those_of_unit_length():
    # The axes of a camera are brought to unit length, so that lengths have no derivatives.
    seen, values = cases.cameras(), cases.density()

    def picture(matrices, lengths):
        scaled = torch.cat([matrices[..., :3] * lengths[:, None], matrices[..., 3:]], -1)
        return ct.render(values, dataclasses.replace(seen, camera_to_world=scaled), lattice=cases.lattice())

    def turned(turns, lengths):
        return picture(cases.moved(seen, turns, torch.zeros(2, 3)).camera_to_world, lengths)

    assert torch.allclose(picture(seen.camera_to_world, 3 * torch.ones(2, 3)), picture(seen.camera_to_world, torch.ones(2, 3)))
    assert agrees(turned, 0.1 * cases.random(2, 3, low=-1), cases.random(2, 3, seed=5, low=0.5, high=2))


@pytest.mark.parametrize("model", ["grey", "linear"])
def test_emission_and_background(model):
    def picture(emission, background):
        return ct.render(
            cases.density(), cases.cameras(), lattice=cases.lattice(), emission=emission, emission_model=model, background=background
        )  # fmt: skip

    # Colors are rounded to single precision and pictures linear in them: a step of a power of two makes no error.
    colors = [torch.tensor(color, dtype=torch.float64) for color in ((0.5, 0.25, 1.0), (0.125, 0.75, 0.375))]
    assert agrees(picture, *colors, eps=COLOR_STEP)


@pytest.mark.parametrize("kind", [None, *KINDS])
def test_density_scale(kind):
    function = kind and cases.function(kind)

    def picture(scale):
        return ct.render(
            cases.density(), cases.cameras(), lattice=cases.lattice(), function=function, density_scale=scale,
            emission=(0, 0, 0) if kind else (1, 0.5, 0),
        )  # fmt: skip

    assert agrees(picture, torch.tensor(1.3, dtype=torch.float64))


@pytest.mark.parametrize("kind", [None, Texture])
@pytest.mark.parametrize("quadrature", ["midpoint", "riemann"])
def test_step(quadrature, kind):
    settings = through(kind) if kind else {"lattice": cases.lattice(), **LOOK}

    def picture(step):
        return ct.render(cases.density(), cases.cameras(), quadrature=quadrature, step=step, **settings)

    assert agrees(picture, torch.tensor(0.61, dtype=torch.float64))


@pytest.mark.parametrize("supersample", [1, 2])
@pytest.mark.parametrize("views", [1, 3])
@pytest.mark.parametrize("quadrature", [None, "preintegrated"])
def test_everything_at_once(quadrature, views, supersample):
    seen = cases.cameras(views)

    def picture(values, parameters, turns, shifts, focal, scale):
        moved = dataclasses.replace(cases.moved(seen, turns, shifts), focal=focal)
        return ct.render(values, moved, **through(Texture, density_scale=scale) | {"function": Texture(parameters)},
                         quadrature=quadrature, supersample=supersample)  # fmt: skip

    motions = [0.05 * cases.random(views, 3, seed=seed, low=-1) for seed in (5, 6)]
    parameters = cases.function(Texture).parameters
    assert agrees(picture, cases.density(), parameters, *motions, seen.focal, torch.tensor(0.9, dtype=torch.float64))
