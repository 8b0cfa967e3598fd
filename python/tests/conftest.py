"""What all tests share: where the fixtures and the program are."""

import pathlib

import pytest

pytest_plugins = ["cumulo.testing.plugin"]


@pytest.fixture(scope="session")
def fixtures():
    """The folder of the committed fixtures."""
    return pathlib.Path(__file__).resolve().parents[2] / "fixtures"


@pytest.fixture(scope="session")
def cumulo():
    """`cumulo.run.cumulo`; a test that asks for it fails where the program is not built."""
    from cumulo import run

    try:
        run.program()
    except FileNotFoundError as missing:
        pytest.fail(str(missing))
    return run.cumulo
