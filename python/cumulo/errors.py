"""The exception of what Cumulo refuses."""

from __future__ import annotations

import pathlib
from typing import Any


class CumuloError(RuntimeError):
    """Cumulo refused, or a part of the work failed.

    `code` is the name of the error, such as "memory-limit", which stays whatever the words become; `what` says what was
    found and what was expected; `path` is the file (None if there is none), `part` the grid, layer, frame or argument
    in it; `remedy` says what to do. `report` is the document of work of which parts failed, else None.
    """

    def __init__(
        self,
        code: str,
        what: str,
        path: str | None = None,
        part: str | None = None,
        remedy: str | None = None,
        report: dict[str, Any] | None = None,
    ) -> None:
        place = "".join(f"{word}: " for word in (path, part) if word)
        super().__init__(f"{place}{what}" + (f"\n  {remedy}" if remedy else ""))
        self.code = code
        self.what = what
        self.path = None if path is None else pathlib.Path(path)
        self.part = part
        self.remedy = remedy
        self.report = report

    def __reduce__(self) -> tuple[Any, ...]:
        path = None if self.path is None else str(self.path)
        return type(self), (self.code, self.what, path, self.part, self.remedy, self.report)
