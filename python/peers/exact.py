"""Exact line integrals of the trilinear interpolant of a voxel grid, in f64.

Voxel centres lie at integer index coordinates and the grid is surrounded by zeros, so the field falls
linearly to 0 over the cell beyond the outermost centres. Between two crossings of planes through voxel
centres the field along a ray is a product of three linear functions, a cubic: two Gauss-Legendre points
per piece integrate it without error. Nothing here is shared with the renderer it is used to judge.
"""

import math

import numba
import numpy as np

GAUSS = 0.5 / math.sqrt(3.0)


@numba.njit(inline="always")
def _sample(padded, x, y, z, ix, iy, iz):
    """Interpolant inside the cell whose lower corner is index `(ix, iy, iz)`; `padded` is `[z, y, x]`."""
    fx, fy, fz = x - ix, y - iy, z - iz
    i, j, k = ix + 1, iy + 1, iz + 1
    a = padded[k, j, i] * (1 - fx) + padded[k, j, i + 1] * fx
    b = padded[k, j + 1, i] * (1 - fx) + padded[k, j + 1, i + 1] * fx
    c = padded[k + 1, j, i] * (1 - fx) + padded[k + 1, j, i + 1] * fx
    d = padded[k + 1, j + 1, i] * (1 - fx) + padded[k + 1, j + 1, i + 1] * fx
    return (a * (1 - fy) + b * fy) * (1 - fz) + (c * (1 - fy) + d * fy) * fz


@numba.njit
def _clip(o, d, size, t0, t1):
    """Part of `[t0, t1]` inside the box of the padded grid, -1..size on each axis."""
    for a in range(3):
        if d[a] == 0.0:
            if o[a] <= -1.0 or o[a] >= size[a]:
                return 0.0, 0.0
        else:
            u, v = (-1.0 - o[a]) / d[a], (size[a] - o[a]) / d[a]
            t0, t1 = max(t0, min(u, v)), min(t1, max(u, v))
    return t0, t1


@numba.njit
def _integral(padded, size, o, d, near, far):
    t, end = _clip(o, d, size, near, far)
    if t >= end:
        return 0.0
    # Next plane to be crossed on each axis. Its parameter is always computed from the plane's own
    # number, never by adding steps, so errors do not build up along the ray.
    plane, step, at = np.zeros(3), np.zeros(3), np.full(3, np.inf)
    for a in range(3):
        if d[a] > 0.0:
            plane[a], step[a] = math.floor(o[a] + t * d[a]) + 1.0, 1.0
        elif d[a] < 0.0:
            plane[a], step[a] = math.ceil(o[a] + t * d[a]) - 1.0, -1.0
        if d[a] != 0.0:
            at[a] = (plane[a] - o[a]) / d[a]
    total = 0.0
    while t < end:
        a = 0
        if at[1] < at[a]:
            a = 1
        if at[2] < at[a]:
            a = 2
        stop = min(at[a], end)
        if stop > t:
            m, h = 0.5 * (t + stop), stop - t
            # The middle of the piece names the cell: rounding at its ends cannot pick a wrong one.
            ix = min(max(int(math.floor(o[0] + m * d[0])), -1), size[0] - 1)
            iy = min(max(int(math.floor(o[1] + m * d[1])), -1), size[1] - 1)
            iz = min(max(int(math.floor(o[2] + m * d[2])), -1), size[2] - 1)
            for s in (m - GAUSS * h, m + GAUSS * h):
                total += 0.5 * h * _sample(padded, o[0] + s * d[0], o[1] + s * d[1], o[2] + s * d[2], ix, iy, iz)
            t = stop
        plane[a] += step[a]
        at[a] = (plane[a] - o[a]) / d[a]
    return total


@numba.njit(parallel=True)
def _integrals(padded, size, origins, directions, near, far):
    out = np.empty(len(origins))
    for i in numba.prange(len(origins)):
        out[i] = _integral(padded, size, origins[i], directions[i], near, far)
    return out


def line_integrals(volume, origins, directions, near=0.0, far=np.inf):
    """Integrals over `t` in `[near, far]` of the field at `origin + t direction`.

    `volume` is `[z, y, x]`; `origins` and `directions` are `[..., 3]` in index space, ordered x, y, z. Give
    directions the index-space image of a unit world vector and the integral is over world length.
    """
    padded = np.pad(np.asarray(volume, np.float64), 1)
    size = np.array(volume.shape[::-1], np.int64)
    origins, directions = np.broadcast_arrays(np.asarray(origins, np.float64), np.asarray(directions, np.float64))
    o, d = (np.ascontiguousarray(v.reshape(-1, 3)) for v in (origins, directions))
    return _integrals(padded, size, o, d, near, far).reshape(origins.shape[:-1])
