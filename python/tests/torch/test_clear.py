"""Derivatives by voxels at which a transfer function is clear, or as good as constant: those from which a volume grows."""

import cumulo.torch as ct
import cases
import pytest
import torch

SHAPE = (26, 26, 26)
# Colors and extinctions at densities 0 and 1: clear at 0, and not.
FUNCTIONS = {"clear": [[0.9, 0.4, 0.2, 0.0], [0.1, 0.5, 0.8, 9.0]], "hazy": [[0.9, 0.4, 0.2, 0.4], [0.1, 0.5, 0.8, 9.0]]}


def nearly_empty(dtype):
    """Zeros, but for a block and a speck."""
    values = torch.zeros(SHAPE, dtype=dtype)
    values[10:14, 9:13, 11:15] = 0.5
    values[3, 20, 4] = 0.2
    return values


def loss(values, function, quadrature):
    """A sum over two views of the whole box."""
    eyes = torch.tensor([[2.4, 1.3, 0.8], [-1.1, -0.7, 2.6]], dtype=torch.float64)
    cameras = ct.Cameras(ct.look_at(eyes), [[44.0, 44.0]] * 2, [[16.0, 16.0]] * 2, (32, 32))
    lattice = ct.Lattice.box(SHAPE, voxel_size=1 / 26)
    # Texels lie at densities 0 and 1.
    function = ct.Texture(torch.tensor(FUNCTIONS[function], dtype=torch.float64), (-0.5, 1.5))
    picture = ct.render(values, cameras, lattice=lattice, function=function, background=(0.2, 0.1, 0.4), quadrature=quadrature)
    return (picture.double() * torch.tensor([0.3, 0.7, -0.2, 0.5])).sum()


@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.parametrize("quadrature", ["exact", "preintegrated", "preintegrated:0.1", "midpoint:0.5"])
def test_empty_space_has_derivatives(function, quadrature):
    whole = {}
    for dtype in (torch.float32, torch.float64):
        values = nearly_empty(dtype).requires_grad_()
        loss(values, function, quadrature).backward()
        whole[dtype] = values.grad.double()
    by_voxel = whole[torch.float64]
    # A rounding may change the number of a ray's nodes in a brick.
    assert cases.apart(whole[torch.float32], by_voxel) < (0.02 if quadrature.startswith("pre") else 1e-3)
    # No part of the box is left out, wherever it lies among the bricks of a field.
    for corner in [(1, 1, 1), (8, 8, 8), (18, 2, 9), (12, 18, 18), (9, 8, 10), (2, 19, 3)]:
        block = torch.zeros(SHAPE, dtype=torch.float64)
        x, y, z = corner
        block[x : x + 5, y : y + 5, z : z + 5] = 1
        ahead = nearly_empty(torch.float64)
        with torch.no_grad():
            # Where the function has a kink, its derivative is that for greater densities.
            difference = [loss(ahead + h * block, function, quadrature) for h in (0, 1e-6)]
        difference = float(difference[1] - difference[0]) / 1e-6
        found = float((by_voxel * block).sum())
        assert abs(found - difference) < 0.02 * abs(difference), (corner, found, difference)
    exact = nearly_empty(torch.float64).requires_grad_()
    loss(exact, function, "exact").backward()
    assert cases.apart(by_voxel, exact.grad) < 0.05


@pytest.mark.parametrize("least", [1e-1, 1e-4, 1e-12])
def test_what_is_nearly_clear_is_not_left_out(least):
    function = ct.Piecewise(torch.tensor([[0, 0.5, 0.5, 0.5, least], [0.1, 0.5, 0.5, 0.5, 1.1 * least], [1, 0.5, 0.5, 0.5, 4.0]]))
    cameras = ct.Cameras(ct.look_at(torch.tensor([[2.4, 1.3, 0.8]])), [[44.0, 44.0]], [[16.0, 16.0]], (32, 32))

    def alpha(values):
        return ct.render(values, cameras, lattice=ct.Lattice.box((9, 9, 9), voxel_size=1 / 9), function=function)[..., 3].sum()

    zeros, ones = torch.zeros(9, 9, 9, dtype=torch.float64, requires_grad=True), torch.ones(9, 9, 9, dtype=torch.float64)
    alpha(zeros).backward()
    _, forwards = torch.func.jvp(alpha, (zeros.detach(),), (ones,))
    assert float(zeros.grad.sum()) == pytest.approx(float(forwards), rel=1e-9) and float(forwards) > 0.1 * least


@pytest.mark.parametrize("quadrature", ["exact", "preintegrated", "midpoint:0.5"])
def test_a_volume_grows_from_nothing(quadrature):
    values = torch.zeros(SHAPE, dtype=torch.float32, requires_grad=True)
    loss(values, "clear", quadrature).backward()
    inner = values.grad[1:-1, 1:-1, 1:-1]
    assert (inner != 0).float().mean() > 0.99
    _, forwards = torch.func.jvp(lambda v: loss(v, "clear", quadrature), (values.detach(),), (torch.ones(SHAPE),))
    assert float(forwards) == pytest.approx(float(values.grad.double().sum()), rel=1e-3)
