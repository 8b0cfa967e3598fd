"""`cumulo.torch.render` as an operation: what is computed, both modes as adjoints of each other, and what is refused."""

import dataclasses

import cases
import cumulo.torch as ct
import numpy as np
import pytest
import torch
from cumulo import CumuloError, pictures
from cumulo.fields import Cameras, Gaussians, Piecewise, Texture

LOOK = {"density_scale": 1.3, "emission": (0.5, 0.25, 1.0), "background": (0.25, 0.5, 0.75)}
# Relative error of sums of a few hundred products.
EXACT = {torch.float64: 1e-10, torch.float32: 1e-4}


@pytest.fixture
def calls(monkeypatch):
    """What the native module's derivatives are asked for: values, function, rays."""
    asked = []
    original = pictures.vjp

    def vjp(given, by_pictures, wanted):
        asked.append(tuple(wanted))
        return original(given, by_pictures, wanted)

    monkeypatch.setattr(pictures, "vjp", vjp)
    return asked


def everything(dtype=torch.float64):
    """A function of all that pictures through a texture depend on, and where it is taken."""
    seen = cases.cameras()
    inputs = {
        "values": cases.density(dtype=dtype), "parameters": cases.function(Texture).parameters,
        "camera_to_world": seen.camera_to_world, "focal": seen.focal, "centre": seen.centre,
        "density_scale": torch.tensor(0.8, dtype=torch.float64), "background": torch.tensor([0.25, 0.5, 0.75], dtype=torch.float64),
        "step": torch.tensor(0.61, dtype=torch.float64),
    }  # fmt: skip

    def picture(values, parameters, camera_to_world, focal, centre, density_scale, background, step):
        cameras = dataclasses.replace(seen, camera_to_world=camera_to_world, focal=focal, centre=centre)
        return ct.render(values, cameras, lattice=cases.lattice(), function=Texture(parameters), density_scale=density_scale,
                         background=background, quadrature="midpoint", step=step)  # fmt: skip

    return picture, inputs


# Which of the native module's derivatives each input needs: values, function, rays. The others come with any.
NEEDED = {
    "values": (True, False, False), "parameters": (False, True, False), "camera_to_world": (False, False, True),
    "focal": (False, False, True), "centre": (False, False, True), "density_scale": (False, False, False),
    "background": (False, False, False), "step": (False, False, True),
}  # fmt: skip


@pytest.mark.parametrize("name", NEEDED)
def test_what_requires_a_gradient_is_computed_and_nothing_else(calls, name):
    picture, inputs = everything()
    inputs[name].requires_grad_()
    picture(**inputs).square().sum().backward()
    assert calls == [NEEDED[name]]
    for other, tensor in inputs.items():
        assert (tensor.grad is not None) == (other == name)
    assert inputs[name].grad.shape == inputs[name].shape and inputs[name].grad.abs().max() > 0


def test_nothing_is_kept_or_computed_without_gradients(calls):
    picture, inputs = everything()
    assert not picture(**inputs).requires_grad
    inputs["values"].requires_grad_()
    with torch.no_grad():
        assert not picture(**inputs).requires_grad
    with torch.inference_mode():
        assert picture(**inputs).is_inference()
    kept = []
    with torch.autograd.graph.saved_tensors_hooks(lambda tensor: kept.append(tensor) or tensor, lambda tensor: tensor):
        found = picture(**inputs)
    # The inputs themselves and the emission, three numbers: no picture, no samples along rays.
    given = {tensor.data_ptr() for tensor in inputs.values()}
    assert given < {tensor.data_ptr() for tensor in kept}
    assert sum(tensor.numel() for tensor in kept if tensor.data_ptr() not in given) == 3
    assert found.requires_grad and calls == []


def test_gradients_add_up_and_a_graph_that_is_retained_gives_the_same_again():
    picture, inputs = everything()
    values = inputs["values"].requires_grad_()
    loss = picture(**inputs).square().sum()
    loss.backward(retain_graph=True)
    once = values.grad.clone()
    loss.backward()
    assert torch.equal(values.grad, 2 * once)
    with pytest.raises(RuntimeError, match="second time"):
        loss.backward()


def test_second_derivatives_are_refused_by_name():
    picture, inputs = everything()
    values = inputs["values"].requires_grad_()
    [first] = torch.autograd.grad(picture(**inputs).square().sum(), values, create_graph=True)
    with pytest.raises(NotImplementedError, match="cumulo.torch.render has no second derivatives.*difference quotients"):
        first.sum().backward()

    def loss(values):
        return picture(**{**inputs, "values": values}).square().sum()

    with pytest.raises(NotImplementedError, match="no second derivatives"):
        torch.autograd.functional.hvp(loss, values.detach(), torch.ones_like(values))
    with pytest.raises(NotImplementedError, match="no second derivatives"):
        torch.func.grad(lambda values: torch.func.grad(loss)(values).sum())(values.detach())
    with pytest.raises(NotImplementedError, match="no second derivatives"):
        torch.func.grad(lambda values: torch.func.jvp(loss, (values,), (values,))[1])(values.detach())


def test_changes_in_place_are_found():
    picture, inputs = everything()
    values = inputs["values"].requires_grad_()
    found = picture(**inputs).sum()
    with torch.no_grad():
        values.mul_(2)
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        found.backward()
    # The picture itself is no longer needed.
    found = picture(**inputs)
    found.mul_(2).sum().backward()
    assert values.grad.abs().max() > 0


def test_derivatives_that_are_not_finite_give_gradients_that_are_not():
    picture, inputs = everything()
    inputs["values"].requires_grad_()
    inputs["focal"].requires_grad_()
    (picture(**inputs) * float("nan")).sum().backward()
    assert inputs["values"].grad.isnan().all() and inputs["focal"].grad.isnan().all()
    inputs["values"].grad = None
    (picture(**inputs)[..., 0] / torch.zeros(())).sum().backward()
    assert not inputs["values"].grad.isfinite().any()


@pytest.mark.parametrize("dtype", EXACT)
def test_both_modes_are_adjoint(dtype):
    picture, inputs = everything(dtype)
    names = [name for name in inputs if name != "camera_to_world"]
    turns = 0.1 * cases.random(2, 3, low=-1)
    shifts = torch.zeros(2, 3, dtype=torch.float64)

    def of(turns, *others):
        moved = cases.moved(cases.cameras(), turns, shifts)
        return picture(camera_to_world=moved.camera_to_world, **dict(zip(names, others, strict=True)))

    points = (turns, *(inputs[name] for name in names))
    for seed in range(5):
        directions = tuple(cases.random(*p.shape, seed=seed + i, low=-1, dtype=p.dtype) for i, p in enumerate(points))
        weights = cases.random(*cases.PICTURES, seed=90 + seed, low=-1, dtype=dtype)
        value, forward = torch.func.jvp(of, points, directions)
        again, pull = torch.func.vjp(of, *points)
        assert torch.equal(value, again) and forward.dtype == dtype
        sides = [(forward * weights).double().sum(), sum((b * d).double().sum() for b, d in zip(pull(weights), directions, strict=True))]
        norm = forward.double().norm() * weights.double().norm()
        assert abs(sides[0] - sides[1]) <= EXACT[dtype] * norm, (seed, sides)


@pytest.mark.parametrize("kind", [None, Texture, Piecewise, Gaussians, "pre-shaded", "sparse"])
@pytest.mark.parametrize("dtype", EXACT)
def test_both_modes_are_adjoint_for_all_kinds_of_values(dtype, kind, tmp_path):
    places, values, settings = cases.lattice(), cases.density(dtype=dtype), dict(LOOK)
    if kind == "pre-shaded":
        values, settings = cases.pre_shaded(dtype), {"background": LOOK["background"]}
    elif kind == "sparse":
        places, values = cases.sparse(tmp_path)
        values = torch.from_numpy(values).to(dtype)
    elif kind:
        settings = {"function": cases.function(kind), "background": LOOK["background"]}

    def picture(values):
        return ct.render(values, cases.cameras(), lattice=places, **settings)

    for seed in range(3):
        direction = cases.random(*values.shape, seed=seed, low=-1, dtype=dtype)
        weights = cases.random(*cases.PICTURES, seed=7 + seed, low=-1, dtype=dtype)
        _, forward = torch.func.jvp(picture, (values,), (direction,))
        [back] = torch.func.vjp(picture, values)[1](weights)
        sides = [(forward * weights).double().sum(), (back * direction).double().sum()]
        assert abs(sides[0] - sides[1]) <= EXACT[dtype] * forward.double().norm() * weights.double().norm()


def test_forward_mode_by_dual_numbers():
    picture, inputs = everything()
    direction = cases.random(*cases.SHAPE, seed=3)
    with torch.autograd.forward_ad.dual_level():
        dual = torch.autograd.forward_ad.make_dual(inputs["values"], direction)
        value, change = torch.autograd.forward_ad.unpack_dual(picture(**{**inputs, "values": dual}))
    quotient = (picture(**{**inputs, "values": inputs["values"] + 1e-6 * direction}) - value) / 1e-6
    assert torch.allclose(change, quotient, atol=1e-5) and change.abs().max() > 0.1


def test_functions_of_torch_func():
    picture, inputs = everything()

    def loss(values, background):
        return picture(**{**inputs, "values": values, "background": background}).square().mean()

    by_values, by_background = torch.func.grad(loss, argnums=(0, 1))(inputs["values"], inputs["background"])
    inputs["values"].requires_grad_()
    inputs["background"].requires_grad_()
    loss(inputs["values"], inputs["background"]).backward()
    assert torch.equal(by_values, inputs["values"].grad) and torch.equal(by_background, inputs["background"].grad)
    with pytest.raises(RuntimeError, match="vmap"):
        torch.func.vmap(lambda values: picture(**{**inputs, "values": values}))(cases.density((2, *cases.SHAPE)))


def test_gradients_by_numpy_are_the_same():
    picture, inputs = everything()
    for tensor in inputs.values():
        tensor.requires_grad_()
    weights = cases.random(*cases.PICTURES, seed=2, low=-1)
    picture(**inputs).backward(weights)
    plain = {name: tensor.detach().numpy() for name, tensor in inputs.items()}
    cameras = Cameras(plain["camera_to_world"], plain["focal"], plain["centre"], cases.SIZE)
    found = pictures.gradient(
        weights.numpy(), plain["values"], cameras, wrt=("values", "function", "cameras"), lattice=cases.lattice(),
        function=Texture(plain["parameters"]), density_scale=0.8, background=plain["background"], quadrature="midpoint", step=0.61,
    )  # fmt: skip
    for name, ours in {
        "values": found.values, "parameters": found.function, "focal": found.cameras[:, 6:8], "centre": found.cameras[:, 8:],
        "density_scale": found.density_scale, "background": found.background, "step": found.step,
    }.items():  # fmt: skip
        assert np.array_equal(inputs[name].grad.numpy(), ours), name
    assert np.array_equal(inputs["camera_to_world"].grad.numpy()[:, :3, 3], found.cameras[:, :3])
    with pytest.raises(CumuloError, match="step"):
        pictures.gradient(weights.numpy(), plain["values"], cameras, wrt=("step",))


def test_a_motion_by_look_at_keeps_its_target_in_the_middle():
    eye = torch.tensor([[1.0, 2.0, 0.5], [0.3, -2.0, 1.0]], dtype=torch.float64)
    matrices = ct.look_at(eye, (0.1, 0.2, 0.3))
    assert torch.allclose(matrices[:, :3, :3].transpose(1, 2) @ matrices[:, :3, :3], torch.eye(3, dtype=torch.float64))
    assert torch.allclose(torch.linalg.det(matrices), torch.ones(2, dtype=torch.float64))
    seen = torch.linalg.inv(matrices) @ torch.tensor([0.1, 0.2, 0.3, 1.0], dtype=torch.float64)
    assert torch.allclose(seen[:, :2], torch.zeros(2, 2, dtype=torch.float64)) and (seen[:, 2] < 0).all()
    assert ct.look_at(eye[0]).shape == (4, 4)
    assert torch.autograd.gradcheck(ct.look_at, (eye.requires_grad_(),))
