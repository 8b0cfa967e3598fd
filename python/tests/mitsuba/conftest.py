"""The program as these tests use it, and the table of what they found."""

import pytest
import sides

TABLE = pytest.StashKey[list]()


def pytest_configure(config):
    """Begins the table."""
    config.stash[TABLE] = []


@pytest.fixture(scope="session")
def table(pytestconfig):
    """Rows (scene, verdict, threshold) that are printed after the tests."""
    return pytestconfig.stash[TABLE]


@pytest.fixture(scope="session")
def renderer(cumulo, tmp_path_factory):
    """Renders scenes by Cumulo."""
    return sides.Cumulo(cumulo, tmp_path_factory.mktemp("cumulo"))


def pytest_terminal_summary(terminalreporter, config):
    """Prints the table, whether tests passed or not."""
    rows = config.stash[TABLE]
    if not rows:
        return
    terminalreporter.section("largest |z| of pixels and of 8x8 blocks, what chance allows, mean radiance")
    terminalreporter.write_line(f"{'scene':44} {'pixel':>7} {'block':>7} {'allowed':>8} {'Cumulo':>10} {'other':>10}")
    for name, v, allowed in rows:
        terminalreporter.write_line(f"{name:44} {v.pixel:7.2f} {v.block:7.2f} {allowed:8.2f} {v.ours:10.5f} {v.theirs:10.5f}")
