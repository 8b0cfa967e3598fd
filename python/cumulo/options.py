"""Command-line words from Python's arguments."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Union

Path = Union[str, "os.PathLike[str]"]
Option = Union[None, bool, int, float, str, "os.PathLike[str]", "Iterable[object]"]


def word(value: object) -> str:
    """A value as the program reads it: numbers of a tuple joined by commas, others as text."""
    if isinstance(value, tuple):
        return ",".join(word(item) for item in value)
    return os.fspath(value) if isinstance(value, os.PathLike) else str(value)


def extent(value: tuple[int, int] | str | None) -> str | None:
    """(width, height) as `WIDTHxHEIGHT`; text stays."""
    return "x".join(str(v) for v in value) if isinstance(value, tuple) else value


def words(options: Mapping[str, Option]) -> list[str]:
    """Options as words: `max_bounces=4` becomes `--max-bounces=4`, True a flag, a list the option repeated, a
    tuple numbers joined by commas; None and False are left out."""
    made = []
    for name, value in options.items():
        flag = "--" + name.strip("_").replace("_", "-")
        if value is None or value is False:
            continue
        if value is True:
            made.append(flag)
        elif isinstance(value, list):
            made += [f"{flag}={word(item)}" for item in value]
        else:
            made.append(f"{flag}={word(value)}")
    return made
