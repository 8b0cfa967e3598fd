"""A volume fitted by two processes, half of the views each, is the one that a single process fits."""

import os
import sys

import cases
import cumulo.torch as ct
import pytest
import torch
import torch.distributed
import torch.multiprocessing
from cumulo.fields import Cameras, Lattice

SHAPE, VIEWS, STEPS = (12, 12, 12), 8, 15


def fit(rank, world, folder):
    """Fits densities to pictures of every `world`-th view and writes them, with the losses."""
    if world > 1:
        torch.distributed.init_process_group("gloo", init_method=f"file://{folder}/meeting", rank=rank, world_size=world)
    torch.set_num_threads(1)
    lattice = Lattice.box(SHAPE, voxel_size=1 / SHAPE[0])
    every = Cameras.around(lattice, VIEWS, (24, 24))
    own = slice(rank, None, world)
    seen = Cameras(every.camera_to_world[own], every.focal[own], every.centre[own], every.size)
    settings = {"lattice": lattice, "density_scale": 5.0, "threads": 1}
    target = ct.render(cases.density(SHAPE, torch.float32, seed=3), seen, **settings)
    logarithms = torch.full(SHAPE, -1.0, requires_grad=True)
    optimizer = torch.optim.Adam([logarithms], lr=0.1)
    losses = []
    for _ in range(STEPS):
        optimizer.zero_grad()
        difference = ct.render(torch.nn.functional.softplus(logarithms), seen, **settings) - target
        # A share of the mean over all views.
        loss = difference[..., 3].square().sum() / (VIEWS * 24 * 24)
        loss.backward()
        losses.append(loss.detach().clone())
        if world > 1:
            torch.distributed.all_reduce(logarithms.grad)
            torch.distributed.all_reduce(losses[-1])
        optimizer.step()
    torch.save((logarithms.detach(), torch.stack(losses)), f"{folder}/{world}-{rank}.pt")
    if world > 1:
        torch.distributed.destroy_process_group()
        # A thread of gloo that still lets go of a tensor would abort an interpreter that is being finalised.
        os._exit(0)


@pytest.mark.skipif(not torch.distributed.is_available(), reason="this PyTorch has no torch.distributed")
def test_two_processes_fit_what_one_fits(tmp_path, monkeypatch):
    # New processes find the same modules.
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    fit(0, 1, str(tmp_path))
    torch.multiprocessing.spawn(fit, (2, str(tmp_path)), nprocs=2)
    one, first, second = (torch.load(tmp_path / name) for name in ("1-0.pt", "2-0.pt", "2-1.pt"))
    assert torch.equal(first[0], second[0]), "both processes hold the same volume"
    assert one[1][-1] < 0.3 * one[1][0], "the fit gets somewhere"
    apart = (one[0] - first[0]).abs().max().item()
    print(f"densities' logarithms apart by at most {apart:.1e}, losses by {(one[1] - first[1]).abs().max().item():.1e}")
    assert torch.allclose(one[0], first[0], rtol=0, atol=1e-5)
    assert torch.allclose(one[1], first[1], rtol=1e-5)
