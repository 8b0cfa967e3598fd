"""A third opinion, slow and plain: exact optical depth in f64, box chords in closed form, and the statistics by which
ray-marched pictures are judged; others are by `cumulo.testing`, for which pictures of Cycles are kept here."""

import math
import pathlib
import statistics

import cumulo.blender  # noqa: F401  brings `openvdb`
import numpy as np
import openvdb
from cumulo.testing import Reference

PACKAGE = pathlib.Path(cumulo.__file__).parent


def of_cycles(name, film, files, **settings):
    """Pictures of Cycles as a reference: `film(seed)` renders one, [height, width, 4]. They are kept until one of `files`
    changes, which are the volume and the test that makes the scene, or of `settings`, or of the modules that help it."""
    modules = [PACKAGE / f"{module}.py" for module in ("blender", "capture", "exr", "padding")]
    modules += [*sorted((PACKAGE / "cycles").glob("*.py")), pathlib.Path(__file__).with_name("smoke_scene.py")]
    return Reference(name, lambda seed, path: film(seed), [*files, *modules], settings)


def box_chord(camera, low, high, matrix=None, offsets=((0.5, 0.5),), near=0.0):
    """Length, in world units, that each ray runs inside a box (in `matrix`'s frame), f64
    [offset, height, width]; nothing before `near` along the viewing axis counts."""
    origin, direction = camera.rays(offsets)
    start = near_distance(camera, direction, near)
    to_box = np.linalg.inv(np.eye(4) if matrix is None else np.asarray(matrix, dtype=np.float64))
    origin = origin @ to_box[:3, :3].T + to_box[:3, 3]
    direction = direction @ to_box[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (np.asarray(low) - origin) / direction, (np.asarray(high) - origin) / direction
    enter = np.nanmax(np.minimum(first, second), axis=-1)
    leave = np.nanmin(np.maximum(first, second), axis=-1)
    # World directions have unit length, so that the parameter is a world length.
    return np.maximum(leave - np.maximum(enter, start), 0.0)


def near_distance(camera, direction, near):
    """Distance along each ray at which the near plane lies."""
    return near / (direction @ -camera.camera_to_world[:3, 2])


def optical_depth(path, grid, camera, near=0.0):
    """Line integral of a grid along the rays through pixel centres, world units, [height, width] f64.

    Between the planes through voxel centres a trilinear field is a cubic along any ray, which two
    Gauss points integrate exactly; so this is exact but for f64's rounding.
    """
    source = openvdb.read(str(path), grid)
    low, high = source.evalActiveVoxelBoundingBox()
    low, high = np.array(low) - 1, np.array(high) + 1
    values = np.zeros(high - low + 1, dtype=np.float32)
    source.copyToArray(values, ijk=low.tolist())
    origin, direction = (v[0].reshape(-1, 3) for v in camera.rays())
    start = near_distance(camera, direction, near)
    zero = np.array(source.transform.indexToWorld((0, 0, 0)))
    axes = np.stack([np.array(source.transform.indexToWorld(e)) - zero for e in np.eye(3).tolist()], axis=1)
    to_index = np.linalg.inv(axes)
    origin, direction = (origin - zero) @ to_index.T - low, direction @ to_index.T
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (0 - origin) / direction, (high - low - origin) / direction
        enter = np.maximum(np.nanmax(np.minimum(first, second), axis=-1), start)
        leave = np.maximum(np.nanmin(np.maximum(first, second), axis=-1), enter)
        planes = [(np.arange(high[a] - low[a] + 1) - origin[:, a, None]) / direction[:, a, None] for a in range(3)]
    inside = np.nan_to_num(np.concatenate(planes, axis=1), nan=0.0)
    borders = np.sort(np.clip(inside, enter[:, None], leave[:, None]), axis=1)
    total = np.zeros(len(origin))
    for before, after in zip(borders.T[:-1], borders.T[1:]):
        for gauss in (0.5 - math.sqrt(1 / 12), 0.5 + math.sqrt(1 / 12)):
            at = origin + (before + gauss * (after - before))[:, None] * direction
            total += 0.5 * (after - before) * trilinear(values, at)
    return total.reshape(camera.height, camera.width)


def trilinear(values, at):
    """Interpolated `values` at index positions [n, 3]; the border cells go on outside."""
    cell = np.clip(np.floor(at).astype(np.int64), 0, np.array(values.shape) - 2)
    t = at - cell
    flat = values.reshape(-1)
    strides = (values.shape[1] * values.shape[2], values.shape[2], 1)
    base = cell @ np.array(strides)
    total = np.zeros(len(at))
    for corner in range(8):
        bits = [corner >> axis & 1 for axis in range(3)]
        weight = np.prod([t[:, axis] if bit else 1.0 - t[:, axis] for axis, bit in enumerate(bits)], axis=0)
        total += weight * flat[base + sum(bit * stride for bit, stride in zip(bits, strides))]
    return total


def excess(first, second, expected, samples=None, block=8, alpha=1e-3):
    """Judges two renders of one view by different seeds, [height, width] each, against `expected`,
    a picture without noise.

    For every block of pixels the mean difference is divided by its standard error, taken from the
    seeds' own difference: var((a + b)/2) = (a - b)^2/4. The largest is compared with what `alpha`
    allows over all blocks (Šidak), with the wider tails of a t distribution, because the error comes
    from the block's few pixels. Returns largest/allowed: above 1 the pictures differ. The picture as a
    whole counts as one block more, which finds small differences that go the same way everywhere.

    `samples`: per pixel, of a ray-marched picture. Its optical depth is itself an estimate, whose
    variance v lifts the mean of exp by T v/2; v is read off the noise, and that much is allowed.
    """
    first, second = (np.asarray(p, dtype=np.float64) for p in (first, second))
    expected = np.asarray(expected, dtype=np.float64)
    error, variance = 0.5 * (first + second) - expected, 0.25 * (first - second) ** 2
    lift = np.zeros_like(error)
    if samples:
        # One sample's variance is 2 samples x variance of the mean of two pictures.
        lift = samples * variance / np.maximum(expected, 0.05)
    blocks = [
        (slice(y, y + block), slice(x, x + block))
        for y in range(0, error.shape[0], block)
        for x in range(0, error.shape[1], block)
    ] + [(slice(None), slice(None))]
    chance = 1.0 - (1.0 - alpha) ** (1.0 / len(blocks))
    normal = statistics.NormalDist().inv_cdf(1.0 - 0.5 * chance)
    worst = 0.0
    for part in blocks:
        count = error[part].size
        # Cornish-Fisher expansion of Student's quantile. Pixels share the noise unequally: of those
        # that carry it there are about 3 (sum v)^2 / sum v^2, v being squares of normal numbers.
        squares = (variance[part] ** 2).sum()
        free = min(count, 3.0 * variance[part].sum() ** 2 / squares) if squares else count
        allowed = normal + (normal**3 + normal) / (4 * free) + (5 * normal**5 + 16 * normal**3 + 3 * normal) / (96 * free**2)
        # Both pictures are stored in f32, at most 1.
        spread = math.sqrt(variance[part].sum()) / count + 2.0**-22
        worst = max(worst, max(0.0, abs(error[part].mean()) - lift[part].mean()) / (allowed * spread))
    return worst
