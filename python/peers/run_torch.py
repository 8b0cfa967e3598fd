"""PyTorch's automatic differentiation through a ray caster (B2): value and gradient by all voxels of the plume, 128
cubed, of a mean squared difference, one view of 128² pixels through a transfer function.

    run_torch.py smoke.npy [--threads 2] [--rounds 3]

Samples lie half a voxel apart; blocks of 16 along all rays are checkpointed, which is what keeps the memory small
and is the faster way as well on a processor.
"""

import argparse
import math
import statistics
import time

import numpy as np
import torch
from field import emit
from torch.nn.functional import grid_sample
from torch.utils.checkpoint import checkpoint

PIXELS, STEP, BLOCK = 128, 0.5, 16

p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
p.add_argument("volume")
p.add_argument("--threads", type=int, default=2)
p.add_argument("--rounds", type=int, default=3)
a = p.parse_args()
torch.set_num_threads(a.threads)

truth = torch.from_numpy(np.load(a.volume))
n = len(truth)
x = torch.linspace(0, 1, 256)
extinction = 20 * torch.exp(-(((x - 0.25) / 0.08) ** 2)) + 60 * torch.exp(-(((x - 0.7) / 0.1) ** 2))
function = torch.stack([x, 0.5 + 0.5 * torch.sin(6 * x), 1 - x, extinction], 1)

# The volume fills the unit cube.
away = np.array([2.4 * math.cos(0.3), 2.4 * math.sin(0.3), 0.6])
forward = -away / np.linalg.norm(away)
right = np.cross(forward, [0, 0, 1])
right /= np.linalg.norm(right)
up = np.cross(right, forward)
across = math.tan(math.radians(20)) * (2 * (np.arange(PIXELS) + 0.5) / PIXELS - 1)
rays = (forward + across[None, :, None] * right - across[:, None, None] * up).reshape(-1, 3)
rays = torch.tensor(rays / np.linalg.norm(rays, axis=1, keepdims=True), dtype=torch.float32)
origin = torch.tensor(0.5 + away, dtype=torch.float32)
near, far = (0 - origin) / rays, (1 - origin) / rays
enter, leave = torch.minimum(near, far).amax(1), torch.maximum(near, far).amin(1)
hit = leave > enter
rays, enter, leave = rays[hit], enter[hit], leave[hit]
step = STEP / n
steps = int(torch.ceil((leave - enter).max() / step))


def block(volume, first, light, alpha):
    """Adds so many samples of every ray."""
    t = enter[:, None] + (torch.arange(first, min(first + BLOCK, steps)) + 0.5) * step
    points = origin + t[..., None] * rays[:, None]
    density = grid_sample(
        volume[None, None], (2 * points - 1)[None, None], mode="bilinear", padding_mode="border", align_corners=False
    )[0, 0, 0]
    place = (density * 255).clamp(0, 254.999)
    knot = place.floor().long()
    share = (place - knot)[..., None]
    looks = function[knot] * (1 - share) + function[knot + 1] * share
    opaque = 1 - torch.exp(-looks[..., 3] * (t < leave[:, None]) * step)
    open_ = torch.cumprod(torch.cat([torch.ones(len(rays), 1), 1 - opaque], 1), 1)
    weight = (1 - alpha)[:, None] * open_[:, :-1] * opaque
    return light + (weight[..., None] * looks[..., :3]).sum(1), 1 - (1 - alpha) * open_[:, -1]


def round_trip():
    """Seconds of value and gradient."""
    volume = (0.8 * truth).requires_grad_(True)
    start = time.perf_counter()
    light, alpha = torch.zeros(len(rays), 3), torch.zeros(len(rays))
    for first in range(0, steps, BLOCK):
        light, alpha = checkpoint(block, volume, first, light, alpha, use_reentrant=False)
    (((light - 0.3) ** 2).mean() + ((alpha - 0.3) ** 2).mean()).backward()
    return time.perf_counter() - start


def resident():
    """Megabytes of this process: now and at most."""
    with open("/proc/self/status", encoding="ascii") as status:
        lines = dict(line.split(":", 1) for line in status)
    return [int(lines[name].split()[0]) / 1024 for name in ("VmRSS", "VmHWM")]


base = resident()[0]
round_trip()
seconds = statistics.median(round_trip() for _ in range(a.rounds))
emit(
    bench="B2", peer="pytorch", version=torch.__version__, threads=a.threads, seconds=round(seconds, 4),
    megabytes=round(resident()[1] - base, 1),
)  # fmt: skip
