"""The pytest plugin: options, and the fixture `cumulo_parity`."""

from __future__ import annotations

import pathlib
import re
from collections.abc import Iterator
from typing import Any

import pytest

MISSING = ("fail", "render")
_PAGES = pytest.StashKey["list[pathlib.Path]"]()
_REGENERATED = pytest.StashKey["list[str]"]()


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("cumulo", "render regression tests")
    group.addoption("--cumulo-regenerate", action="store_true", help="render references again; tests that use them fail")
    group.addoption("--cumulo-references", metavar="DIR", help="folder of the references (ini: cumulo_references)")
    group.addoption("--cumulo-failures", metavar="DIR", help="folder for what failing tests leave (ini: cumulo_failures)")
    parser.addini("cumulo_references", "folder of the references, from the root folder", default="references")
    parser.addini("cumulo_failures", "folder for what failing tests leave, from the root folder", default="cumulo-failures")
    parser.addini("cumulo_missing_references", "fail, or render (a cache that nobody keeps)", default="fail")


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_PAGES], config.stash[_REGENERATED] = [], []
    if config.getini("cumulo_missing_references") not in MISSING:
        raise pytest.UsageError(f"cumulo_missing_references must be one of {', '.join(MISSING)}")


def _folder(config: pytest.Config, name: str) -> pathlib.Path:
    given = config.getoption(f"--cumulo-{name}")
    return pathlib.Path(given).absolute() if given else config.rootpath / config.getini(f"cumulo_{name}")


@pytest.fixture
def cumulo_parity(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Compares pictures with references: `cumulo.testing.Parity`."""
    from .parity import Parity
    from .reference import Store

    config = request.config
    store = Store(
        _folder(config, "references"),
        config.rootpath,
        config.getini("cumulo_missing_references"),
        config.getoption("--cumulo-regenerate"),
    )
    name = re.sub(r"[^\w.-]+", "_", request.node.name)
    module = re.sub(r"[^\w.-]+", "_", request.node.nodeid.split("::")[0].removesuffix(".py"))
    parity = Parity(store, _folder(config, "failures") / module / name, tmp_path_factory.mktemp("candidates"), request.node.nodeid)
    yield parity
    config.stash[_PAGES] += parity.pages
    config.stash[_REGENERATED] += parity.regenerated


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    pages, regenerated = config.stash[_PAGES], config.stash[_REGENERATED]
    if pages or regenerated:
        terminalreporter.section("cumulo")
        for name in regenerated:
            terminalreporter.line(f"rendered again: {name}")
        for path in pages:
            terminalreporter.line(f"page: {path}")
