"""`python/torch.ipynb` runs, and finds what it says: a transfer function, a viewpoint, and a density."""

import os
import pathlib
import re
import sys

import pytest

nbclient = pytest.importorskip("nbclient")
nbformat = pytest.importorskip("nbformat")

PACKAGE = pathlib.Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def book(tmp_path_factory):
    """The notebook after a run, in a folder of its own."""
    found = nbformat.read(PACKAGE / "torch.ipynb", as_version=4)
    kept = [cell for cell in found.cells if cell.cell_type == "code" and (cell.outputs or cell.execution_count)]
    assert not kept, "outputs are cleared in the repository"
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = os.pathsep.join([str(PACKAGE), *sys.path])
    try:
        folder = {"metadata": {"path": str(tmp_path_factory.mktemp("notebook"))}}
        nbclient.NotebookClient(found, timeout=300, kernel_name="python3", resources=folder).execute()
    finally:
        if before is None:
            del os.environ["PYTHONPATH"]
        else:
            os.environ["PYTHONPATH"] = before
    return found


def numbers(book, start):
    """The numbers of the line that starts so."""
    outputs = [output for cell in book.cells if cell.cell_type == "code" for output in cell.outputs]
    said = "".join(output.get("text", "") for output in outputs)
    [line] = [line for line in said.splitlines() if line.startswith(start)]
    return [float(number) for number in re.findall(r"-?\d+\.?\d*(?:e[-+]\d+)?", line)]


def test_a_transfer_function_under_a_perceptual_loss(book):
    first, last, before, after = numbers(book, "perceptual loss")
    assert last < 1e-2 * first and after > before + 15


def test_a_viewpoint_under_the_score_of_a_network(book):
    first, last, rank = numbers(book, "score")
    assert last > first + 0.5 and rank >= 90


def test_a_density_that_a_network_represents(book):
    network, voxels = numbers(book, "density by the network")
    assert network > 28 and network > voxels + 4


def test_its_figures_are_drawn(book):
    outputs = [output for cell in book.cells if cell.cell_type == "code" for output in cell.outputs]
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 5
    assert not any(output.output_type == "error" or output.get("name") == "stderr" for output in outputs)
