"""`cumulo.torch.render` beside PyTorch's own operations (B2), in one process and in turns: value and gradient by all
voxels of the plume, 128 cubed, one view of 128² pixels through a transfer function of 256 texels.

    PYTHONPATH=.. run_torch_cumulo.py [smoke.npy] [--threads 2] [--rounds 7] [--quadrature exact preintegrated midpoint:0.5]

Prints a JSON line for each quadrature: seconds of both (medians), their ratio, the megabytes that each takes above what
the process had, and how far the gradients are from PyTorch's, which samples half a voxel apart. Then a line for what a
call costs beside the native module's work, and one for calls between operations of PyTorch on all its threads.
"""

import argparse
import math
import statistics
import time

import cumulo.torch as ct
import numpy as np
import torch
import torch.multiprocessing
from cumulo import __version__
from field import emit, smoke
from run_torch import HALF, PIXELS, Caster, camera, mean_square, resident, transfer_function

# Calls on a volume of 2³ voxels in a round.
SMALL = 200


class Ours:
    """The same view of the same volume [z, y, x]."""

    def __init__(self, n, hit, quadrature, threads):
        position, right, up, forward = camera()
        matrix = np.eye(4)
        matrix[:3] = np.stack([right, up, -forward, position], 1)
        focal = PIXELS / 2 / math.tan(HALF)
        self.cameras = ct.Cameras(matrix[None], np.full((1, 2), focal), np.full((1, 2), PIXELS / 2), (PIXELS, PIXELS))
        self.hit = hit
        # Texels at 0, 1/255, ..., 1.
        function = ct.Texture(transfer_function(), (-0.5 / 255, 1 + 0.5 / 255))
        lattice = ct.Lattice.box((n, n, n), voxel_size=1 / n, origin=[0.5 / n] * 3)
        self.settings = {"lattice": lattice, "function": function, "quadrature": quadrature, "threads": threads}

    def __call__(self, volume):
        """Radiance and alpha of the rays that meet the volume, [x, y, z]."""
        pixels = ct.render(volume, self.cameras, **self.settings).reshape(-1, 4)[self.hit]
        return pixels[:, :3], pixels[:, 3]


def round_trip(cast, truth):
    """Seconds of value and gradient, and the gradient."""
    volume = (0.8 * truth).requires_grad_(True)
    start = time.perf_counter()
    mean_square(*cast(volume)).backward()
    return time.perf_counter() - start, volume.grad


def made(which, n, quadrature, threads):
    """One side, and the order of axes that it takes."""
    theirs = Caster(n)
    return (theirs, (0, 1, 2)) if which == "pytorch" else (Ours(n, theirs.hit, quadrature, threads), (2, 1, 0))


def work_of_memory(truth, *which):
    """Megabytes that round trips take at most, above those of a process that has imported all."""
    torch.set_num_threads(which[-1])
    cast, order = made(*which)
    base = resident()[0]
    for _ in range(2):
        round_trip(cast, truth.permute(order).contiguous())
    return round(resident()[1] - base, 1)


def megabytes(truth, *which):
    """The same, in a process of its own."""
    with torch.multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(work_of_memory, (truth, *which))


def compare(truth, quadrature, a):
    """A line for a quadrature."""
    n = len(truth)
    (ours, order), (theirs, _) = (made(which, n, quadrature, a.threads) for which in ("cumulo", "pytorch"))
    turned = truth.permute(order).contiguous()
    memory = [megabytes(truth, which, n, quadrature, a.threads) for which in ("cumulo", "pytorch")]
    seconds = ([], [])
    for _ in range(a.rounds):
        for taken, cast, volume in ((seconds[0], ours, turned), (seconds[1], theirs, truth)):
            taken.append(round_trip(cast, volume))
    gradients = seconds[0][-1][1].permute(2, 1, 0), seconds[1][-1][1]
    medians = [statistics.median(s for s, _ in taken) for taken in seconds]
    ratios = sorted(b / a for (a, _), (b, _) in zip(*seconds, strict=True))
    emit(
        bench="B2", peer="pytorch", version=torch.__version__, cumulo=__version__, threads=a.threads,
        quadrature=quadrature or "default", rounds=a.rounds, seconds=round(medians[0], 4), peer_seconds=round(medians[1], 4),
        ratio=round(statistics.median(ratios), 1), least_ratio=round(ratios[0], 1), megabytes=memory[0],
        peer_megabytes=memory[1], gradients_apart=round(((gradients[0] - gradients[1]).norm() / gradients[1].norm()).item(), 4),
    )  # fmt: skip


def overhead(rounds):
    """What a call costs beside the native module: one pixel of a volume of 2³ voxels."""
    values = torch.full((2, 2, 2), 0.5)
    lattice = ct.Lattice.box((2, 2, 2))
    cameras = ct.Cameras(np.array([np.diag([1.0, 1, 1, 1]) + np.eye(4)[2][:, None] * np.eye(4)[3] * 4]), [[1.0, 1.0]], [[0.5, 0.5]], (1, 1))
    given = ct.pictures.prepared(values, cameras, lattice=lattice, threads=1)

    def call():
        ct.render(values, cameras, lattice=lattice, threads=1)

    def work():
        given.scene.render()

    def both_ways():
        leaf = values.requires_grad_(True)
        ct.render(leaf, cameras, lattice=lattice, threads=1).sum().backward()
        values.requires_grad_(False)

    def microseconds(of):
        start = time.perf_counter()
        for _ in range(SMALL):
            of()
        return 1e6 * (time.perf_counter() - start) / SMALL

    taken = [[microseconds(of) for of in (call, work, both_ways)] for _ in range(rounds)]
    medians = [statistics.median(column) for column in zip(*taken, strict=True)]
    emit(
        bench="call", microseconds=round(medians[0], 1), native_microseconds=round(medians[1], 1),
        overhead_microseconds=round(medians[0] - medians[1], 1), with_gradient_microseconds=round(medians[2], 1),
    )  # fmt: skip


def between(truth, quadrature, a):
    """Ours alone, and between products of matrices on PyTorch's threads."""
    ours = Ours(len(truth), slice(None), quadrature, a.threads)
    turned = truth.permute(2, 1, 0).contiguous()
    square = torch.rand(768, 768)
    alone, among = [], []
    for _ in range(2 * a.rounds):
        round_trip(ours, turned)
        alone.append(round_trip(ours, turned)[0])
        square @ square
        among.append(round_trip(ours, turned)[0])
    medians = [statistics.median(taken) for taken in (alone, among)]
    emit(bench="between", torch_threads=torch.get_num_threads(), seconds=round(medians[0], 4),
         between_seconds=round(medians[1], 4), slower=round(medians[1] / medians[0] - 1, 3))  # fmt: skip


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("volume", nargs="?", help="the plume [z, y, x] (default: made here)")
    p.add_argument("--threads", type=int, default=2)
    p.add_argument("--rounds", type=int, default=7)
    p.add_argument("--quadrature", nargs="+", default=["exact", "preintegrated", "midpoint:0.5"])
    a = p.parse_args()
    torch.set_num_threads(a.threads)
    truth = torch.from_numpy(np.load(a.volume) if a.volume else smoke(128))
    for quadrature in a.quadrature:
        compare(truth, quadrature, a)
    overhead(a.rounds)
    between(truth, a.quadrature[-1], a)


if __name__ == "__main__":
    main()
