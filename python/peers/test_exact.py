"""The exact projector against closed forms and against adaptive quadrature."""

import numpy as np
import pytest
from scipy.integrate import quad
from exact import line_integrals

N = 16


def ramp(n=N):
    z, y, x = np.meshgrid(*[np.arange(n, dtype=float)] * 3, indexing="ij")
    return 0.3 + 0.02 * x - 0.011 * y + 0.007 * z


def blob(n=N):
    z, y, x = np.meshgrid(*[np.arange(n, dtype=float)] * 3, indexing="ij")
    return np.exp(-((x - 7.2) ** 2 + (y - 6.9) ** 2 + (z - 8.4) ** 2) / 18)


def rays(count, seed=3):
    rng = np.random.default_rng(seed)
    d = rng.standard_normal((count, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    return rng.uniform(5, 10, (count, 3)) - 40 * d, d


def trilinear(padded, p):
    """Plain textbook evaluation, sum over eight corners; 0 outside."""
    q = np.asarray(p) + 1
    if (q < 0).any() or (q >= np.array(padded.shape[::-1]) - 1).any():
        return 0.0
    b = np.floor(q).astype(int)
    f = q - b
    return sum(
        padded[b[2] + k, b[1] + j, b[0] + i]
        * (f[0] if i else 1 - f[0]) * (f[1] if j else 1 - f[1]) * (f[2] if k else 1 - f[2])
        for i in (0, 1) for j in (0, 1) for k in (0, 1)
    )


def test_affine_field_inside_the_grid_is_length_times_value_at_the_middle():
    o, d = rays(200)
    # Inside the outermost centres the interpolant of an affine field is that field itself.
    near, far = 38.0, 43.0
    mid = o + 40.5 * d
    expected = 5.0 * (0.3 + mid @ [0.02, -0.011, 0.007])
    # About 20 terms of size 0.1: rounding stays below 20 * 40 eps = 2e-13.
    assert np.abs(line_integrals(ramp(), o, d, near, far) - expected).max() < 1e-12


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1, -1])
def test_ray_along_an_axis_through_centres_sums_the_voxels(axis, sign):
    v = np.random.default_rng(axis).uniform(size=(11, 13, 17))
    o, d = np.array([5.0, 7.0, 3.0]), np.zeros(3)
    o[axis], d[axis] = -50.0 * sign, sign
    line = v[tuple(slice(None) if a == 2 - axis else int(o[2 - a]) for a in range(3))]
    # Trapezia with a zero at both ends: each voxel counts once.
    assert abs(line_integrals(v, o, d) - line.sum()) < 1e-12


def test_ray_along_an_axis_halfway_between_centres_takes_the_mean_of_four_lines():
    v = np.random.default_rng(9).uniform(size=(9, 9, 9))
    got = line_integrals(v, [-20.0, 3.5, 4.5], [1.0, 0.0, 0.0])
    assert abs(got - v[4:6, 3:5].mean((0, 1)).sum()) < 1e-12


def test_diagonal_of_a_single_voxel():
    v = np.zeros((5, 5, 5))
    v[2, 2, 2] = 1
    # Along (1,1,1) the hat is (1-|s|)^3 with t = s sqrt 3: twice sqrt(3)/4.
    d = np.ones(3) / np.sqrt(3)
    assert abs(line_integrals(v, 2 - 30 * d, d) - np.sqrt(3) / 2) < 1e-13


def test_blob_agrees_with_adaptive_quadrature():
    padded = np.pad(blob(), 1)
    for o, d in zip(*rays(12)):
        got = float(line_integrals(blob(), o, d))
        # The interpolant has a kink at every plane through centres; told of them all, adaptive
        # quadrature of each piece reaches rounding. No traversal takes part.
        kinks = np.sort(((np.arange(-1, N + 1)[:, None] - o) / d).ravel())
        kinks = kinks[(kinks > 20) & (kinks < 60)]
        pieces = [quad(lambda t: trilinear(padded, o + t * d), u, v, epsabs=1e-15) for u, v in zip(kinks, kinks[1:])]
        # Some 50 pieces of size up to 1, each within a few eps.
        assert abs(got - sum(p[0] for p in pieces)) < 1e-12


def test_blob_agrees_with_a_fine_midpoint_rule_that_knows_no_kinks():
    padded = np.pad(blob(), 1)
    o, d = (v[0] for v in rays(1, seed=8))
    steps = 200_000
    t = 20 + (np.arange(steps) + 0.5) * (40 / steps)
    expected = sum(trilinear(padded, o + s * d) for s in t) * (40 / steps)
    # h = 2e-4: a smooth piece errs by h^2 / 24 times the jump of the slope over it (below 0.5), a kink by
    # h^2 / 8 times its jump of slope; 100 of them stay below 100 * 0.5 * h^2 / 8 = 3e-7.
    assert abs(float(line_integrals(blob(), o, d)) - expected) < 3e-7


def test_misses_and_rays_in_the_border_planes():
    v = np.ones((4, 4, 4))
    assert line_integrals(v, [-9.0, 9.0, 1.0], [1.0, 0.0, 0.0]) == 0
    assert line_integrals(v, [-9.0, 4.0, 1.0], [1.0, 0.0, 0.0]) == 0
    # Halfway down the border cell the field has half its value.
    assert abs(line_integrals(v, [-9.0, 3.5, 1.0], [1.0, 0.0, 0.0]) - 2.0) < 1e-14


def test_segments_add_up():
    o, d = rays(50)
    whole = line_integrals(blob(), o, d)
    parts = line_integrals(blob(), o, d, 0, 40.3) + line_integrals(blob(), o, d, 40.3, np.inf)
    assert np.abs(whole - parts).max() < 1e-12
