"""The program: `python -m cumulo`, and the command `cumulo` that the package installs."""

from __future__ import annotations

import os
import sys

from . import _native


def main() -> None:
    """Runs the program on the command line of this process."""
    code = _native.main(["cumulo", *sys.argv[1:]])
    # Threads of the program may still wait for signals.
    sys.stdout.flush()
    os._exit(code)


if __name__ == "__main__":
    main()
