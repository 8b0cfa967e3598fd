"""Whatever is given to `cumulo.torch.render` and cannot be used is an exception that says what to do."""

import copy
import dataclasses
import math
import pickle

import cases
import cumulo.torch as ct
import numpy as np
import pytest
import torch
from cumulo import CumuloError, pictures
from cumulo.fields import Gaussians, Lattice, Piecewise, Texture

NAN, INF = math.nan, math.inf
SEEN = cases.cameras()
HUGE = (2**14, 2**13, 2**13)
NUMBERS = cases.density()


def holding(value, dtype=torch.float64):
    """Densities of which one is replaced."""
    found = cases.density(dtype=dtype)
    found[1, 2, 1] = value
    return found


def turned(change):
    """Cameras whose matrices are changed."""
    matrices = SEEN.camera_to_world.clone()
    change(matrices)
    return dataclasses.replace(SEEN, camera_to_world=matrices)


def cameras(**fields):
    return dataclasses.replace(SEEN, **fields)


def refused(values=NUMBERS, seen=SEEN, *, part=None, code="invalid", **settings):
    """Expects an exception with its code and a remedy or at least both numbers, and gives it."""
    with pytest.raises(CumuloError) as caught:
        ct.render(values, seen, **settings)
    error = caught.value
    assert error.code == code and error.what and (part is None or error.part == part), (error.code, error.part, error)
    return error


@pytest.mark.parametrize("value", [NAN, INF, -INF, -1.0])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_values_that_are_no_densities(value, dtype):
    error = refused(holding(value, dtype))
    assert "place 22 of 60" in error.what and "softplus" in error.remedy
    colors = cases.pre_shaded(dtype)
    colors[1, 2, 1, 3] = value
    assert "place 22 of 60" in refused(colors).what


def test_negative_densities_are_fine_where_a_function_maps_them():
    function = cases.function(Texture)
    assert ct.render(holding(-1.0), SEEN, function=function).isfinite().all()
    assert "not finite" in refused(holding(NAN), function=function).what


@pytest.mark.parametrize("value", [1e-310, 1e30, 1e300])
@pytest.mark.parametrize("kind", [None, Texture])
def test_very_small_and_very_large_densities_give_finite_pictures_and_gradients(value, kind):
    values = holding(value).requires_grad_()
    found = ct.render(values, SEEN, emission=(0, 0, 0) if kind else (1, 0.5, 0.2), function=kind and cases.function(kind))
    found.sum().backward()
    assert found.isfinite().all() and values.grad.isfinite().all()


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.int32, torch.int64, torch.uint8, torch.bool,
                                   torch.complex64, torch.complex128])  # fmt: skip
def test_other_types(dtype):
    assert "float32 or float64" in refused(NUMBERS.to(dtype), part="values").what
    if not (dtype.is_floating_point or dtype.is_complex):
        with pytest.raises(RuntimeError, match="floating point"):
            NUMBERS.to(dtype).requires_grad_()


@pytest.mark.parametrize("values", [
    NUMBERS.permute(2, 1, 0), NUMBERS[::2], NUMBERS[:, :, 1:], torch.ones(1, 1, 1).expand(4, 5, 3), torch.ones(1, 1, 1).expand(HUGE),
])  # fmt: skip
def test_strides_are_not_copied_in_silence(values):
    assert "contiguous" in refused(values, part="values").remedy


def test_a_slice_that_lies_in_order_is_taken_as_it_is():
    assert torch.equal(ct.render(NUMBERS[1:3], SEEN), ct.render(NUMBERS[1:3].clone(), SEEN))


@pytest.mark.parametrize("values", [torch.empty(4, 5, 3, device="meta"), torch.empty(HUGE, device="meta"), NUMBERS.to_sparse()])
def test_tensors_without_a_memory_of_the_processor(values):
    assert "cpu()" in refused(values, part="values").remedy


@pytest.mark.parametrize("values", [None, "density", [0.5], object(), NUMBERS.numpy()])
def test_objects(values):
    refused(values, part="values")
    if not isinstance(values, np.ndarray):
        with pytest.raises(CumuloError, match="NumPy array"):
            pictures.render(values, cases.cameras())


@pytest.mark.parametrize("shape", [(), (0,), (60,), (5, 3), (4, 5, 3, 3), (1, 1, 4, 5, 3), (0, 5, 3), (4, 0, 3), (4, 5, 0), (4, 5, 3, 0)])
def test_other_shapes(shape):
    refused(torch.zeros(shape))
    refused(torch.zeros(shape), lattice=cases.lattice())


def test_lattices_of_other_values():
    refused(lattice=Lattice.box((3, 5, 4)), part="values")
    refused(lattice="box", part="lattice")
    assert refused(lattice=Lattice.box(cases.SHAPE, max_memory=100), code="memory-limit").remedy


@pytest.mark.parametrize("arguments", [
    {"shape": HUGE}, {"shape": (2**62,) * 3}, {"shape": (2**64, 2, 2)}, {"shape": (-1, 2, 2)}, {"shape": (0, 2, 2)}, {"shape": (2, 2)},
    {"shape": (2.5, 2, 2)}, {"shape": (2, 2, 2), "voxel_size": NAN}, {"shape": (2, 2, 2), "voxel_size": 0.0},
    {"shape": (2, 2, 2), "origin": (1.0, 2.0)}, {"shape": (2, 2, 2), "origin": (NAN, 0.0, 0.0)},
    {"shape": (2, 2, 2), "transform": np.eye(3)}, {"shape": (2, 2, 2), "transform": np.diag([1.0, 0.0, 1.0, 1.0])},
    {"shape": (2, 2, 2), "transform": np.full((4, 4), NAN)},
])  # fmt: skip
def test_lattices_that_are_none(arguments):
    with pytest.raises(CumuloError) as caught:
        Lattice.box(**arguments)
    assert caught.value.code in ("invalid", "unsupported") and caught.value.remedy


def put(*place, value):
    return lambda matrices: matrices.__setitem__(place, value)


@pytest.mark.parametrize("seen", [
    "cameras", None, cameras(camera_to_world=SEEN.camera_to_world[:0], focal=SEEN.focal[:0], centre=SEEN.centre[:0]),
    turned(put(0, 0, 0, value=NAN)), turned(put(1, 0, 3, value=INF)), turned(put(0, 0, 0, value=3.0)), turned(put(..., value=0.0)),
    turned(put(0, 3, 0, value=1.0)), cameras(camera_to_world=SEEN.camera_to_world[:, :3]), cameras(camera_to_world=SEEN.camera_to_world[0]),
    cameras(camera_to_world="matrix"), cameras(camera_to_world=SEEN.camera_to_world.to("meta")),
    cameras(camera_to_world=SEEN.camera_to_world.to(torch.complex64)), cameras(focal=None), cameras(focal=SEEN.focal[:1]),
    cameras(focal=0 * SEEN.focal), cameras(focal=-SEEN.focal), cameras(focal=NAN * SEEN.focal), cameras(centre=NAN * SEEN.centre),
    cameras(size=(0, 4)), cameras(size=(-1, 4)), cameras(size=(2**33, 4)), cameras(size=(2.5, 4)), cameras(size=(4,)), cameras(size=4),
    cameras(near=-1.0), cameras(near=NAN), cameras(near="far"),
])  # fmt: skip
def test_cameras_that_are_none(seen):
    refused(seen=seen)


def test_pictures_that_do_not_fit_into_memory():
    assert "fewer views" in refused(seen=cameras(size=(65536, 65536)), code="memory-limit").remedy


@pytest.mark.parametrize("settings", [
    {"density_scale": -1.0}, {"density_scale": NAN}, {"density_scale": INF}, {"density_scale": torch.ones(2)}, {"density_scale": "auto"},
    {"density_scale": None}, {"emission": (NAN, 0, 0)}, {"emission": (-1, 0, 0)}, {"emission": (1, 0)}, {"emission": 1.0},
    {"emission": (1e300, 0, 0)}, {"emission": "red"}, {"emission_model": "blue"}, {"background": (NAN, 0, 0)}, {"background": (1e300, 0, 0)},
    {"background": torch.ones(4)}, {"step": 0.5}, {"step": 0.5, "quadrature": "exact"}, {"step": 0.0, "quadrature": "midpoint"},
    {"step": NAN, "quadrature": "midpoint"}, {"step": 1e-9, "quadrature": "midpoint"}, {"step": torch.ones(2), "quadrature": "riemann"},
    {"quadrature": "simpson"}, {"quadrature": 3}, {"quadrature": "midpoint"}, {"supersample": 0}, {"supersample": -1},
    {"supersample": 1000}, {"supersample": 1.5}, {"threads": -1}, {"threads": 10**6}, {"threads": "all"},
])  # fmt: skip
def test_settings(settings):
    refused(**settings)


@pytest.mark.parametrize("function", [
    "viridis", Texture(torch.tensor([[1.0, 1, 1, -1], [1, 1, 1, 1]])), Texture(torch.tensor([[1.0, 1, 1, NAN], [1, 1, 1, 1]])),
    Texture(torch.tensor([[-1.0, 1, 1, 1], [1, 1, 1, 1]])), Texture(torch.zeros(0, 4)), Texture(torch.ones(4, 5)), Texture(torch.ones(4, 3)),
    Texture(torch.ones(8)), Texture(torch.ones(4, 4), (1.0, 0.0)), Texture(torch.ones(4, 4), (NAN, 1.0)), Texture(torch.ones(4, 4), (0, 1, 2)),
    Texture("texels"), Texture(None), Piecewise(torch.tensor([[0.5, 1, 1, 1, 1], [0.2, 1, 1, 1, 1]])),
    Piecewise(torch.tensor([[0.5, 1.0, 1, 1, 1]] * 3)), Gaussians(torch.tensor([[0.5, 1000.0, 1, 1, 1, 1]])),
    Gaussians(torch.tensor([[0.5, -1.0, 1, 1, 1, -1]])), Gaussians(torch.tensor([[0.5, -100.0, 1, 1, 1, 1]])),
])  # fmt: skip
def test_functions(function):
    refused(function=function, part="function" if not hasattr(function, "domain") or len(function.domain) == 2 else "domain")


def test_functions_of_pre_shaded_volumes():
    refused(cases.pre_shaded(), function=cases.function(Texture), part="function")


def test_derivatives_of_other_pictures():
    values, seen = NUMBERS.numpy(), cases.cameras()
    by = np.ones(cases.PICTURES)
    for wrong, said in (
        (by.astype(np.float32), "precision"), (by[:1], "shape"), (by * NAN, "not finite"), (by.transpose(0, 2, 1, 3), "contiguous"),
        ("ones", "NumPy"),
    ):  # fmt: skip
        with pytest.raises(CumuloError, match=said):
            pictures.gradient(wrong, values, seen)
    picture = ct.render(NUMBERS.clone().requires_grad_(), seen)
    with pytest.raises(RuntimeError, match="shape"):
        picture.backward(torch.ones(1, 4, 5, 4))
    # Autograd brings derivatives to the precision and order of the pictures.
    picture.backward(torch.ones(2, 5, 4, 4, dtype=torch.float32).transpose(1, 2))


def test_what_was_refused_leaves_the_next_call_as_it_was():
    before = ct.render(NUMBERS, SEEN)
    refused(holding(NAN))
    refused(supersample=0)
    assert torch.equal(ct.render(NUMBERS, SEEN), before)


@pytest.mark.parametrize("settings", [{"density_scale": 2.0}, {"emission": (1, 0, 0)}])
def test_what_a_pre_shaded_volume_has_itself_is_refused(settings):
    with pytest.raises(CumuloError, match="pre-shaded") as refused:
        ct.render(cases.pre_shaded(), cases.cameras(), lattice=cases.lattice(), **settings)
    assert refused.value.remedy


def test_a_source_beside_a_transfer_function_is_refused():
    with pytest.raises(CumuloError, match="a source beside the colors"):
        ct.render(cases.density(), cases.cameras(), lattice=cases.lattice(), function=cases.function(Texture), emission=(1, 0, 0))


def test_masked_arrays_and_tensors_with_a_turned_sign_are_refused():
    values = cases.density()
    with pytest.raises(CumuloError, match="masked"):
        pictures.render(np.ma.masked_array(values.numpy(), values.numpy() > 0.5), cases.cameras(), lattice=cases.lattice())
    with pytest.raises(CumuloError, match="sign"):
        ct.render(torch._neg_view(-values), cases.cameras(), lattice=cases.lattice())


def test_lattices_are_pickled_and_copied(tmp_path):
    for lattice in (cases.lattice(), cases.sparse(tmp_path)[0]):
        for again in (pickle.loads(pickle.dumps(lattice)), copy.deepcopy(lattice)):
            assert again.shape == lattice.shape and np.array_equal(again.transform, lattice.transform)
