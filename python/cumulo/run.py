"""Runs the `cumulo` program and reads its JSON.

    from cumulo.run import cumulo
    report = cumulo("diff", "a.vdb", "b.vdb")
    print(report["grids"][0]["psnr_db"])
"""

from __future__ import annotations

import json
import os
import pathlib
import shutil
import signal
import subprocess
import threading
from collections.abc import Callable, Sequence
from typing import IO, Any

Progress = Callable[[str], None]
"""Receives what the program says on stderr while it works, line by line."""

# How to come by the program, for a package that was installed apart from it.
INSTALL = "`cargo install --path . --locked` in a checkout of Cumulo, or the Debian package that `make deb` makes there"
# Seconds that a program that was asked to stop has for it: it finishes the file it writes.
PATIENCE = 30.0


class CumuloError(RuntimeError):
    """The program refused (exit code 2), or it was killed.

    `message` says what is wrong and where, `hint` what to do about it (None if the program has no
    advice), `kind` is the name of the error, such as "memory-limit", which stays whatever the words become
    (None where the program wrote no document), `code` the exit code (negative: the signal that ended it),
    `stderr` all that it said.
    """

    def __init__(self, arguments: Sequence[str], code: int, stderr: str, kind: str | None = None) -> None:
        super().__init__(f"cumulo {' '.join(arguments)} ended with {code}:\n{stderr.strip()}")
        self.arguments = list(arguments)
        self.code = code
        self.stderr = stderr
        self.kind = kind
        self.message, self.hint = _message_and_hint(stderr)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.arguments, self.code, self.stderr, self.kind)


def _kind(stdout: str) -> str | None:
    """The code of the error in the document that a command with `--json` ended with."""
    try:
        return str(json.loads(stdout)["error"]["code"])
    except (ValueError, TypeError, KeyError):
        return None


def _message_and_hint(stderr: str) -> tuple[str, str | None]:
    """The last message, `cumulo: WHERE: WHAT`, and the indented line after it; usage errors begin with `error:`."""
    lines = stderr.splitlines()
    for start in reversed(range(len(lines))):
        for prefix in ("cumulo: ", "error: "):
            if lines[start].startswith(prefix):
                rest = [line.strip() for line in lines[start + 1 :] if line.startswith("  ") and line.strip()]
                return lines[start].removeprefix(prefix), " ".join(rest) or None
    return stderr.strip(), None


def program() -> str:
    """Path of the program: $CUMULO, else the release build of the checkout around this file, else PATH.

    Raises FileNotFoundError that says how to install it.
    """
    named = os.environ.get("CUMULO")
    if named:
        if not os.path.isfile(named):
            raise FileNotFoundError(f"the environment variable CUMULO names {named}, and there is no such file; correct it")
        return named
    checkout = pathlib.Path(__file__).resolve().parents[2]
    built = checkout / "target" / "release" / "cumulo"
    found = str(built) if built.is_file() else shutil.which("cumulo")
    if not found:
        build = f"`make build` in {checkout}" if (checkout / "Cargo.toml").is_file() else INSTALL
        raise FileNotFoundError(
            "the package runs the program `cumulo`, which is not on PATH; install it:"
            f" {build}; or set the environment variable CUMULO to its path"
        )
    return found


def call(
    arguments: Sequence[str], *, progress: bool | Progress = False, threads: int | None = None
) -> tuple[int, str]:
    """Runs the program and returns its exit code, 0 or 1, and what it wrote on stdout.

    `progress`: True lets the program's stderr through, a function receives its lines (of its bars one
    line every ten seconds). An exception while it runs, KeyboardInterrupt above all, stops the program as
    Ctrl-C does: it removes what is unfinished, or writes what it has, and is waited for.

    Raises CumuloError for other exit codes, FileNotFoundError without a program.
    """
    environment = dict(os.environ)
    if threads is not None:
        environment["RAYON_NUM_THREADS"] = str(threads)
    child = subprocess.Popen(
        [program(), *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=None if progress is True else subprocess.PIPE,
        encoding="utf-8",
        errors="replace",
        env=environment,
    )
    said: list[str] = []
    failed: list[BaseException] = []
    heard = progress if callable(progress) else None
    listener = threading.Thread(target=_listen, args=(child, said, heard, failed), daemon=True)
    try:
        listener.start()
        assert child.stdout is not None
        out = child.stdout.read()
        code = child.wait()
        listener.join()
    except BaseException:
        _stop(child)
        # Its pipe must not be closed under it.
        if listener.ident is not None:
            listener.join(PATIENCE)
        raise
    finally:
        for stream in (child.stdout, child.stderr):
            if stream:
                stream.close()
    if failed:
        raise failed[0]
    if code not in (0, 1):
        raise CumuloError(list(arguments), code, "".join(said) or "(its messages stand above)", _kind(out))
    return code, out


def _listen(
    child: subprocess.Popen[str], said: list[str], heard: Progress | None, failed: list[BaseException]
) -> None:
    stream: IO[str] | None = child.stderr
    if stream is None:
        return
    for line in stream:
        said.append(line)
        if heard and not failed:
            try:
                heard(line.rstrip("\n"))
            except BaseException as error:  # noqa: BLE001  raised again where the program was called
                failed.append(error)
                child.send_signal(signal.SIGINT)


def _stop(child: subprocess.Popen[str]) -> None:
    if child.poll() is None:
        child.send_signal(signal.SIGINT)
        try:
            child.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()


def cumulo(
    *arguments: object,
    json_report: bool = True,
    progress: bool | Progress = False,
    threads: int | None = None,
) -> Any:
    """Runs one command and returns its report as a dict (None with `json_report=False`).

    Exit code 1 (the check found a difference) is no error: the report says what differs. See `call` for
    `progress`, cancellation and errors.
    """
    words = [str(a) for a in arguments]
    if json_report:
        words.append("--json")
    _, out = call(words, progress=progress, threads=threads)
    return json.loads(out) if json_report else None
