"""Runs the `cumulo` program and reads its JSON.

    from cumulo.run import cumulo
    report = cumulo("diff", "a.vdb", "b.vdb")
    print(report["grids"][0]["psnr_db"])
"""

import json
import os
import pathlib
import shutil
import subprocess


class CumuloError(RuntimeError):
    """The program refused (exit code 2, or it was killed); the text is what it said on stderr."""

    def __init__(self, arguments, code, stderr):
        super().__init__(f"cumulo {' '.join(arguments)} ended with {code}:\n{stderr.strip()}")
        self.code = code
        self.stderr = stderr


def program():
    """Path of the program: $CUMULO, else the release build of the checkout around this file, else PATH.

    Raises FileNotFoundError that says how to build it.
    """
    named = os.environ.get("CUMULO")
    built = pathlib.Path(__file__).resolve().parents[2] / "target" / "release" / "cumulo"
    found = named or (str(built) if built.is_file() else shutil.which("cumulo"))
    if not found or not os.path.isfile(found):
        raise FileNotFoundError(
            f"no cumulo program at {found or built}; run `make build`, or set CUMULO to its path"
        )
    return found


def cumulo(*arguments, json_report=True, progress=False, threads=None):
    """Runs one command and returns its report as a dict (None with `json_report=False`).

    Exit code 1 (the check found a difference) is no error: the report says what differs. `progress`
    lets the program's stderr through. Raises CumuloError for everything else.
    """
    words = [str(a) for a in arguments]
    if json_report:
        words.append("--json")
    environment = dict(os.environ)
    if threads is not None:
        environment["RAYON_NUM_THREADS"] = str(threads)
    done = subprocess.run(
        [program(), *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=None if progress else subprocess.PIPE,
        text=True,
        env=environment,
        check=False,
    )
    if done.returncode not in (0, 1):
        raise CumuloError(words, done.returncode, done.stderr or "(its messages stand above)")
    return json.loads(done.stdout) if json_report else None
