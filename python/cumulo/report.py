"""The base of reports: dataclasses built from the program's JSON."""

from __future__ import annotations

import dataclasses
import keyword
import pathlib
import types
import typing
from typing import Any, TypeVar

R = TypeVar("R", bound="Report")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Report:
    """A part of a report; `extra` holds the keys that it has no field for."""

    extra: dict[str, Any] = dataclasses.field(default_factory=dict, repr=False)
    json: dict[str, Any] = dataclasses.field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def of(cls: type[R], data: dict[str, Any]) -> R:
        """Builds the report from JSON. Raises TypeError where a key without a default is missing."""
        hints = _hints(cls)
        names = {key: f"{key}_" if keyword.iskeyword(key) else key for key in data}
        known = {names[key]: _value(hints[names[key]], value) for key, value in data.items() if names[key] in hints}
        extra = {key: value for key, value in data.items() if names[key] not in hints}
        return cls(**known, extra=extra, json=data)


_HINTS: dict[type, dict[str, Any]] = {}


def _hints(cls: type) -> dict[str, Any]:
    """Types of a class's fields, by name."""
    if cls not in _HINTS:
        hints = typing.get_type_hints(cls)
        _HINTS[cls] = {key: hint for key, hint in hints.items() if key not in ("extra", "json")}
    return _HINTS[cls]


def _value(hint: Any, value: Any) -> Any:
    """A JSON value as the type of its field."""
    if value is None:
        return None
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return _value(next(a for a in arguments if a is not type(None)), value)
    if origin is list:
        return [_value(arguments[0], item) for item in value]
    if origin is tuple:
        inner = arguments[0]
        return tuple(_value(inner, item) for item in value)
    if isinstance(hint, type) and issubclass(hint, Report):
        return hint.of(value)
    if hint is pathlib.Path:
        return pathlib.Path(value)
    return value
