"""Memory, copies, interrupts and threads of `cumulo.torch.render`."""

import concurrent.futures
import gc
import pathlib
import signal
import subprocess
import sys
import textwrap
import threading
import time
import tracemalloc

import cases
import cumulo.torch as ct
import numpy as np
import pytest
import torch
from cumulo import _native, pictures
from cumulo.fields import Cameras, Lattice, Texture

PACKAGE = pathlib.Path(__file__).resolve().parents[2]
MEBIBYTE = 1 << 20


def resident():
    """Bytes of this process in memory."""
    with open("/proc/self/statm", encoding="ascii") as pages:
        return int(pages.read().split()[1]) * 4096


def test_a_thousand_renders_and_gradients_leave_the_memory_as_it_was():
    values = cases.density((12, 12, 12), torch.float32).requires_grad_()
    lattice = Lattice.box(values.shape, voxel_size=0.1)
    seen = Cameras.around(lattice, 2, (12, 12))
    texels = cases.random(8, 4).requires_grad_()
    sizes = []
    for turn in range(1000):
        loss = ct.render(values, seen, lattice=lattice, function=Texture(texels), threads=1).square().mean()
        loss.backward()
        values.grad = texels.grad = None
        if turn % 100 == 99:
            gc.collect()
            sizes.append(resident())
    assert sizes[-1] - sizes[0] < 2 * MEBIBYTE, [size / MEBIBYTE for size in sizes]


def test_new_lattices_and_cameras_are_given_back():
    values = cases.density((16, 16, 16), torch.float32)
    sizes = []
    for turn in range(600):
        lattice = Lattice.box(values.shape, voxel_size=0.1 + 1e-4 * turn)
        ct.render(values, Cameras.around(lattice, 1, (16, 16)), lattice=lattice, threads=1)
        if turn in (199, 599):
            sizes.append(resident())
    assert sizes[1] - sizes[0] < 2 * MEBIBYTE


@pytest.fixture
def addresses(monkeypatch):
    """Places in memory of what the native module is given and of what it makes."""
    found = {}
    original = _native.Scene

    class Watched:
        """A scene that notes where its arrays lie."""

        def __init__(self, lattice, values, *others):
            found["values"] = values.ctypes.data
            self.scene = original(lattice, values, *others)

        def render(self):
            made = self.scene.render()
            found["pictures"] = made.ctypes.data
            return made

        def vjp(self, by_pictures, *wanted):
            made = self.scene.vjp(by_pictures, *wanted)
            found["derivatives of pictures"], found["derivatives"] = by_pictures.ctypes.data, made["values"].ctypes.data
            return made

    monkeypatch.setattr(_native, "Scene", Watched)
    return found


def test_nothing_large_is_copied(addresses):
    values = cases.density((64, 64, 64), torch.float32).requires_grad_()
    # PyTorch imports some of its modules when derivatives are first given to it.
    ct.render(values, cases.cameras(), lattice=cases.lattice(values.shape)).backward(torch.ones(cases.PICTURES))
    values.grad = None
    picture = ct.render(values, cases.cameras(size=(160, 128)), lattice=cases.lattice(values.shape))
    assert addresses["values"] == values.data_ptr() and addresses["pictures"] == picture.data_ptr()
    by = torch.rand(picture.shape)
    tracemalloc.start()
    picture.backward(by)
    # NumPy and Python took no memory of the size of the values (1 MiB); a mask of the derivatives is a part of theirs.
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 0.5 * MEBIBYTE
    assert addresses["values"] == values.data_ptr() and addresses["derivatives of pictures"] == by.data_ptr()
    assert addresses["derivatives"] == values.grad.data_ptr()


def test_arrays_by_numpy_are_not_copied(addresses):
    values = cases.density((8, 8, 8)).numpy()
    picture = pictures.render(values, cases.cameras())
    assert addresses == {"values": values.ctypes.data, "pictures": picture.ctypes.data}
    # DLPack gives the same memory.
    pictures.render(torch.from_numpy(values), cases.cameras())
    assert addresses["values"] == values.ctypes.data


@pytest.mark.parametrize("work", ["pictures.render(values, seen, **how)", "pictures.gradient(by, values, seen, **how)"])
def test_ctrl_c_stops_within_a_second(work):
    program = textwrap.dedent(f"""
        import os, signal, sys, threading, time
        import numpy as np
        from cumulo import pictures
        from cumulo.fields import Cameras, Lattice
        values = np.random.default_rng(0).random((96, 96, 96))
        lattice = Lattice.box(values.shape)
        seen = Cameras.around(lattice, 1, (2000, 2000))
        by = np.ones((1, 2000, 2000, 4))
        how = {{"lattice": lattice, "quadrature": "midpoint:0.01"}}
        pictures.render(values, Cameras.around(lattice, 1, (4, 4)), lattice=lattice)
        def interrupt():
            global at
            time.sleep(1)
            at = time.monotonic()
            os.kill(os.getpid(), signal.SIGINT)
        threading.Thread(target=interrupt).start()
        try:
            {work}
        except KeyboardInterrupt:
            print("after", time.monotonic() - at)
        print(pictures.render(values, Cameras.around(lattice, 1, (4, 4)), lattice=lattice).shape)
    """)
    started = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=120, env={"PYTHONPATH": str(PACKAGE)},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    said = done.stdout.splitlines()
    assert said[0].startswith("after ") and float(said[0].split()[1]) < 1.0, (said, time.monotonic() - started)
    assert said[1] == "(1, 4, 4, 4)"


def test_several_threads_at_once_give_what_each_gives_alone():
    lattice = Lattice.box((20, 20, 20), voxel_size=0.1)
    seen = Cameras.around(lattice, 2, (24, 24))

    def work(seed):
        values = cases.density((20, 20, 20), torch.float32, seed=seed).requires_grad_()
        picture = ct.render(values, seen, lattice=lattice, threads=1 + seed % 3)
        picture.square().mean().backward()
        return picture.detach(), values.grad

    alone = [work(seed) for seed in range(8)]
    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        together = list(pool.map(work, [seed for _ in range(5) for seed in range(8)]))
    for turn, found in enumerate(together):
        assert all(torch.equal(a, b) for a, b in zip(found, alone[turn % 8], strict=True))


def test_python_goes_on_while_it_works():
    values = np.random.default_rng(0).random((64, 64, 64))
    lattice = Lattice.box(values.shape)
    seen = Cameras.around(lattice, 1, (300, 300))
    ticks, stop = [], threading.Event()

    def tick():
        while not stop.is_set():
            ticks.append(time.monotonic())
            time.sleep(0.001)

    clock = threading.Thread(target=tick)
    clock.start()
    begin = time.monotonic()
    pictures.render(values, seen, lattice=lattice, quadrature="midpoint:0.05", threads=1)
    end = time.monotonic()
    stop.set()
    clock.join()
    assert end - begin > 0.05 and sum(begin < tick < end for tick in ticks) > 5


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_any_number_of_threads_gives_the_same_bits(threads):
    values = cases.density((20, 20, 20), torch.float32)
    lattice = Lattice.box(values.shape, voxel_size=0.1)
    found = []
    for count in (None, threads):
        leaf = values.clone().requires_grad_()
        texels = cases.function(Texture).parameters.requires_grad_()
        picture = ct.render(leaf, Cameras.around(lattice, 3, (40, 30)), lattice=lattice, function=Texture(texels), threads=count)
        picture.square().mean().backward()
        found.append((picture.detach(), leaf.grad, texels.grad))
    assert all(torch.equal(a, b) for a, b in zip(*found, strict=True))


def test_a_process_that_forks_can_render():
    lattice = Lattice.box(cases.SHAPE)
    before = ct.render(cases.density(), cases.cameras(), lattice=lattice)
    program = f"""
import os, sys
sys.path[:0] = [{str(PACKAGE)!r}, {str(pathlib.Path(__file__).parent)!r}]
import cases, cumulo.torch as ct
before = ct.render(cases.density(), cases.cameras(), threads=2)
child = os.fork()
after = ct.render(cases.density(), cases.cameras(), threads=2)
assert (before == after).all()
if child == 0:
    os._exit(7)
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
print("both")
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert done.stdout == "both\n", done.stderr
    assert before.isfinite().all()
