"""What all tests share: where the fixtures and the program are."""

import os
import pathlib

import pytest

pytest_plugins = ["cumulo.testing.plugin"]

ROOT = pathlib.Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def fixtures():
    """The folder of the committed fixtures."""
    return ROOT / "fixtures"


@pytest.fixture(scope="session")
def cumulo():
    """`cumulo.call`: runs a command in this process and returns its document."""
    import cumulo

    return cumulo.call


@pytest.fixture(scope="session")
def program():
    """Path of the program, for tests of the command line: $CUMULO, else the checkout's release build."""
    path = pathlib.Path(os.environ.get("CUMULO") or ROOT / "target" / "release" / "cumulo")
    if not path.is_file():
        pytest.fail(f"the program {path} is missing; run `make build`, or set the variable CUMULO to its path")
    return str(path)
