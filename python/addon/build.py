#!/usr/bin/env python3
"""Makes the installable .zip of the extension: `python3 python/addon/build.py OUT.zip`.

The archive holds the files beside this one and, as the package `cumulo`, the modules of `python/cumulo` that they use. The
same files give the same bytes.
"""

import pathlib
import sys
import zipfile

HERE = pathlib.Path(__file__).resolve().parent
MODULES = ("capture.py", "exr.py", "options.py", "padding.py", "bpy_scene", "cycles")
TOOLS = ("build.py", "screenshot.py")


def files():
    """Pairs of the name in the archive and the content, in order."""
    root = HERE.parents[1]
    pairs = {path.name: path for path in HERE.glob("*") if path.suffix in (".py", ".toml") and path.name not in TOOLS}
    pairs |= {name: root / name for name in ("LICENSE-MIT", "LICENSE-APACHE")}
    package = HERE.parent / "cumulo"
    for module in MODULES:
        found = sorted((package / module).glob("*.py")) if (package / module).is_dir() else [package / module]
        pairs |= {f"cumulo/{path.relative_to(package).as_posix()}": path for path in found}
    # It is for the command line.
    del pairs["cumulo/bpy_scene/__main__.py"]
    contents = {name: path.read_bytes() for name, path in pairs.items()}
    # The package's own would bring modules that the extension has no use for.
    contents["cumulo/__init__.py"] = b'"""Modules of Cumulo\'s Python package that the extension uses."""\n'
    return sorted(contents.items())


def build(target):
    """Writes the archive."""
    target = pathlib.Path(target)
    target.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files():
            # A date of its own would make each archive another.
            entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            archive.writestr(entry, content)
    return target


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("error: name the archive: python3 python/addon/build.py OUT.zip")
    print(build(sys.argv[1]))
