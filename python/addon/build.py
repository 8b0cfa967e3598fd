#!/usr/bin/env python3
"""Makes the installable .zip of the extension: `python3 python/addon/build.py OUT.zip --wheel FILE.whl`.

The archive holds the files beside this one and the wheel of the package `cumulo`, which Blender installs with the
extension. Its manifest names the wheel, and the platform that the wheel is for. The same files give the same bytes.
"""

import argparse
import pathlib
import re
import sys
import tomllib
import zipfile

HERE = pathlib.Path(__file__).resolve().parent
TOOLS = ("build.py", "screenshot.py")
MANIFEST = "blender_manifest.toml"
# Blender's names of systems and machines, by those of wheels.
SYSTEMS = {"linux": "linux", "manylinux": "linux", "macosx": "macos", "win": "windows"}
MACHINES = {"x86_64": "x64", "amd64": "x64", "arm64": "arm64", "aarch64": "arm64"}


def platform_of(wheel: pathlib.Path) -> str:
    """Blender's platform of a wheel, such as linux-x64. Raises ValueError for a name that is none of the package's."""
    tag = wheel.stem.split("-")[-1].split(".")[0]
    found = re.fullmatch(r"([a-z]+)[0-9_]*?_?(x86_64|amd64|arm64|aarch64)", tag)
    if not (wheel.suffix == ".whl" and wheel.name.startswith("cumulo-") and found and found[1] in SYSTEMS):
        wrong = "its name is none of a wheel of cumulo with a native module"
        raise ValueError(f"{wheel}: {wrong}; make one by python/wheel.sh")
    return f"{SYSTEMS[found[1]]}-{MACHINES[found[2]]}"


def manifest(wheel: pathlib.Path) -> bytes:
    """The extension's manifest with the wheel. Raises ValueError for a wheel of another version."""
    text = (HERE / MANIFEST).read_text(encoding="utf-8")
    version, of_wheel = tomllib.loads(text)["version"], wheel.name.split("-")[1]
    if of_wheel != version:
        raise ValueError(f"{wheel}: it is of version {of_wheel}, and the extension of {version}; make the wheel again")
    # What belongs to no table comes before the first.
    added = f'platforms = ["{platform_of(wheel)}"]\nwheels = ["./wheels/{wheel.name}"]\n\n[permissions]\n'
    return text.replace("[permissions]\n", added, 1).encode()


def files(wheel: pathlib.Path) -> list[tuple[str, bytes]]:
    """Pairs of the name in the archive and the content, in order."""
    platform_of(wheel)
    contents = {path.name: path.read_bytes() for path in HERE.glob("*.py") if path.name not in TOOLS}
    contents |= {name: (HERE.parents[1] / name).read_bytes() for name in ("LICENSE-MIT", "LICENSE-APACHE")}
    contents |= {MANIFEST: manifest(wheel), f"wheels/{wheel.name}": wheel.read_bytes()}
    return sorted(contents.items())


def build(target: pathlib.Path, wheel: pathlib.Path) -> None:
    """Writes the archive."""
    contents = files(wheel)
    target.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in contents:
            # A date of its own would make each archive another.
            entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            archive.writestr(entry, content)


def main() -> None:
    """Builds the archive that the command line names, and prints its path."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("output", type=pathlib.Path, metavar="OUT.zip", help="the archive")
    words = "the package, by python/wheel.sh"
    parser.add_argument("--wheel", type=pathlib.Path, required=True, metavar="FILE.whl", help=words)
    asked = parser.parse_args()
    try:
        build(asked.output, asked.wheel)
    except (ValueError, OSError) as error:
        sys.exit(f"error: {error}")
    print(asked.output)


if __name__ == "__main__":
    main()
