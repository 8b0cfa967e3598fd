"""Progress of commands, as events."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from typing import Any, Union

Event = dict[str, Any]
"""What happened: `event` is "began", "advanced", "ended" (of a `stage` with a `name`, `done` of `total` steps),
"remark", "detail" (with a `text`), "warned" (with `what` and `do`), "failed" (a `frame`) or "unread" (a file; both with
`code` and `error`), "loading" and "working" (inputs of a long task are read between them), "stoppable" (from here on
work that is stopped keeps its result so far); "waiting" after a fifth of a second without another."""

Progress = Union[bool, Callable[[Event], None]]
"""False for none; True for bars of `tqdm`, if it is installed, and remarks on standard error; or a function that
receives each event, on any thread. An exception that it raises stops the work."""


def listener(progress: Progress) -> Callable[[str], None] | None:
    """What the native module calls with the JSON of each event."""
    if progress is False:
        return None
    heard = Shown() if progress is True else progress
    return lambda text: heard(json.loads(text))


class Shown:
    """Bars and remarks on standard error."""

    def __init__(self) -> None:
        try:
            from tqdm.auto import tqdm
        except ImportError:
            tqdm = None
        self._tqdm = tqdm
        self._bars: dict[int, Any] = {}

    def __call__(self, event: Event) -> None:
        """Shows an event."""
        kind = event["event"]
        if kind == "began":
            if self._tqdm is not None:
                self._bars[event["stage"]] = self._tqdm(desc=event["name"], total=event["total"], leave=False)
            else:
                self._say(event["name"])
        elif kind == "advanced" and event["stage"] in self._bars:
            bar = self._bars[event["stage"]]
            bar.total = event["total"]
            bar.set_postfix_str(event["message"], refresh=False)
            bar.update(event["done"] - bar.n)
        elif kind == "ended" and event["stage"] in self._bars:
            self._bars.pop(event["stage"]).close()
        elif kind == "remark":
            self._say(event["text"])
        elif kind == "warned":
            self._say(f"warning: {event['what']}\n  {event['do']}")
        elif kind in ("failed", "unread"):
            self._say(event["error"])

    def _say(self, text: str) -> None:
        if self._tqdm is not None:
            self._tqdm.write(text, file=sys.stderr)
        else:
            print(text, file=sys.stderr)
