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
# Half of the field of view, in radians.
HALF = math.radians(20)


def transfer_function():
    """Radiance and extinction at 256 densities from 0 to 1."""
    x = torch.linspace(0, 1, 256)
    extinction = 20 * torch.exp(-(((x - 0.25) / 0.08) ** 2)) + 60 * torch.exp(-(((x - 0.7) / 0.1) ** 2))
    return torch.stack([x, 0.5 + 0.5 * torch.sin(6 * x), 1 - x, extinction], 1)


def camera():
    """Position, and the axes to the right, up and forward."""
    away = np.array([2.4 * math.cos(0.3), 2.4 * math.sin(0.3), 0.6])
    forward = -away / np.linalg.norm(away)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    return 0.5 + away, right, np.cross(right, forward), forward


def mean_square(light, alpha):
    """The loss on the rays that meet the volume."""
    return ((light - 0.3) ** 2).mean() + ((alpha - 0.3) ** 2).mean()


class Caster:
    """Casts rays at a volume [z, y, x] of n³ voxels, which fills the unit cube."""

    def __init__(self, n):
        position, right, up, forward = camera()
        across = math.tan(HALF) * (2 * (np.arange(PIXELS) + 0.5) / PIXELS - 1)
        rays = (forward + across[None, :, None] * right - across[:, None, None] * up).reshape(-1, 3)
        rays = torch.tensor(rays / np.linalg.norm(rays, axis=1, keepdims=True), dtype=torch.float32)
        self.function = transfer_function()
        self.origin = torch.tensor(position, dtype=torch.float32)
        near, far = (0 - self.origin) / rays, (1 - self.origin) / rays
        enter, leave = torch.minimum(near, far).amax(1), torch.maximum(near, far).amin(1)
        self.hit = leave > enter
        self.rays, self.enter, self.leave = rays[self.hit], enter[self.hit], leave[self.hit]
        self.step = STEP / n
        self.steps = int(torch.ceil((self.leave - self.enter).max() / self.step))

    def block(self, volume, first, light, alpha):
        """Adds so many samples of every ray."""
        t = self.enter[:, None] + (torch.arange(first, min(first + BLOCK, self.steps)) + 0.5) * self.step
        points = self.origin + t[..., None] * self.rays[:, None]
        density = grid_sample(
            volume[None, None], (2 * points - 1)[None, None], mode="bilinear", padding_mode="border", align_corners=False
        )[0, 0, 0]
        place = (density * 255).clamp(0, 254.999)
        knot = place.floor().long()
        share = (place - knot)[..., None]
        looks = self.function[knot] * (1 - share) + self.function[knot + 1] * share
        opaque = 1 - torch.exp(-looks[..., 3] * (t < self.leave[:, None]) * self.step)
        open_ = torch.cumprod(torch.cat([torch.ones(len(self.rays), 1), 1 - opaque], 1), 1)
        weight = (1 - alpha)[:, None] * open_[:, :-1] * opaque
        return light + (weight[..., None] * looks[..., :3]).sum(1), 1 - (1 - alpha) * open_[:, -1]

    def __call__(self, volume):
        """Radiance and alpha of the rays that meet the volume."""
        light, alpha = torch.zeros(len(self.rays), 3), torch.zeros(len(self.rays))
        for first in range(0, self.steps, BLOCK):
            light, alpha = checkpoint(self.block, volume, first, light, alpha, use_reentrant=False)
        return light, alpha


def resident():
    """Megabytes of this process: now and at most."""
    with open("/proc/self/status", encoding="ascii") as status:
        lines = dict(line.split(":", 1) for line in status)
    return [int(lines[name].split()[0]) / 1024 for name in ("VmRSS", "VmHWM")]


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("volume")
    p.add_argument("--threads", type=int, default=2)
    p.add_argument("--rounds", type=int, default=3)
    a = p.parse_args()
    torch.set_num_threads(a.threads)
    truth = torch.from_numpy(np.load(a.volume))
    cast = Caster(len(truth))

    def round_trip():
        """Seconds of value and gradient."""
        volume = (0.8 * truth).requires_grad_(True)
        start = time.perf_counter()
        mean_square(*cast(volume)).backward()
        return time.perf_counter() - start

    base = resident()[0]
    round_trip()
    seconds = statistics.median(round_trip() for _ in range(a.rounds))
    emit(
        bench="B2", peer="pytorch", version=torch.__version__, threads=a.threads, seconds=round(seconds, 4),
        megabytes=round(resident()[1] - base, 1),
    )  # fmt: skip


if __name__ == "__main__":
    main()
