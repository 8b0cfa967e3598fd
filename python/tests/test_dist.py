"""`make dist` gives an archive whose program runs where no library of the system is."""

import json
import os
import pathlib
import re
import shutil
import subprocess

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
BUSYBOX = shutil.which("busybox")
# The first commands of README.md, of small pictures: their exit codes, and what they write.
FIRST = [
    ("view smoke.vdb -o smoke.png", 0, "smoke.png"),
    ("render smoke.vdb --views 1 --size 32x32 --density-scale auto --albedo 0.96 --sun=-1,0.6,0.7 --sun-color 9 "
     "--sky 0.1,0.2,0.4 --samples 4 -o lit.png", 0, "lit.png"),
    ("render smoke.vdb --views 6 --size 32x32 --density-scale auto -o shots", 0, "shots/transforms.json"),
    ("reconstruct density shots -o found.vdb --iterations 4 --report page", 0, "page"),
    ("diff smoke.vdb found.vdb", 1, None),
    ("info smoke.vdb found.vdb", 0, None),
    ("selftest dvr", 0, None),
]  # fmt: skip


def run(words, code=0, **options):
    done = subprocess.run(words, capture_output=True, text=True, **options)
    assert done.returncode == code, (words, done.stdout, done.stderr)
    return done.stdout


@pytest.fixture(scope="module")
def archive():
    """The archive, made anew."""
    run(["make", "-C", ROOT, "dist"], env={**os.environ, "XZ_OPT": "-0"})
    [found] = (ROOT / "target" / "dist").glob("*.tar.xz")
    return found


@pytest.fixture(scope="module")
def folder(archive, tmp_path_factory):
    """The archive, unpacked in the root of a file system that has a shell and nothing else."""
    root = tmp_path_factory.mktemp("system")
    (root / "opt").mkdir()
    run(["tar", "-xf", archive, "-C", root / "opt"])
    [folder] = (root / "opt").iterdir()
    return folder


@pytest.fixture(scope="module")
def points(tmp_path_factory):
    """A grid of points, which is tried by the program started anew before it is read."""
    path = tmp_path_factory.mktemp("grids") / "points.vdb"
    run(["vdb_tool", "-sphere", "dim=16", "-scatter", "count=40", "-points2vdb", "-write", path])
    return path


def test_it_holds_what_it_needs_and_states_its_licenses(archive, folder):
    assert re.fullmatch(r"cumulo-\d+\.\d+\.\d+-linux-\w+\.tar\.xz", archive.name)
    names = [path.name for path in (folder / "lib" / "cumulo").iterdir()]
    for library in ("libopenvdb", "libtbb", "libtbbmalloc", "libblosc", "libboost_iostreams", "libImath", "libc", "ld-"):
        assert any(name.startswith(library) for name in names), (library, names)
    documents = folder / "share" / "doc" / "cumulo"
    licenses = [path.name for path in (documents / "licenses").iterdir()]
    assert {"libopenvdb10.0.txt", "libc6.txt", "LGPL-2.1", "Apache-2.0"} <= set(licenses), licenses
    assert (documents / "src" / "guide" / "getting-started.md").is_file() and (documents / "LICENSE-MIT").is_file()
    assert (folder / "share" / "man" / "man1" / "cumulo-render.1").is_file()
    assert (folder / "share" / "bash-completion" / "completions" / "cumulo").stat().st_size > 1000


def test_links_and_relative_paths_start_it_and_it_starts_itself(folder, points, tmp_path):
    (tmp_path / "a").symlink_to(folder / "bin")
    (tmp_path / "cumulo").symlink_to("a/cumulo")
    for word in (folder / "bin" / "cumulo", tmp_path / "cumulo", "./cumulo", "a/cumulo"):
        assert run([word, "-V"], cwd=tmp_path).startswith("cumulo ")
    built = ROOT / "target" / "release" / "cumulo"
    assert run([tmp_path / "cumulo", "info", points], cwd=tmp_path) == run([built, "info", points], cwd=tmp_path)


@pytest.mark.skipif(os.geteuid() != 0, reason="changing the root of the file system takes root's rights")
@pytest.mark.skipif(BUSYBOX is None, reason="there is no busybox, which python/setup.sh dist installs")
def test_the_first_commands_run_where_no_library_is(folder, points):
    root = folder.parents[1]
    (root / "bin").mkdir()
    shutil.copy(BUSYBOX, root / "bin" / "sh")
    # What a container has, and the start of a process needs.
    (root / "dev").mkdir()
    (root / "dev" / "null").touch()
    (root / "work").mkdir()
    shutil.copy(ROOT / "fixtures" / "plume.vdb", root / "work" / "smoke.vdb")
    shutil.copy(points, root / "work")
    (root / "work" / "libc.so.6").write_bytes(b"no library")
    program = f"/opt/{folder.name}/bin/cumulo"
    # The system's libraries and those to preload, of another C library, count for other programs.
    start = f'cd /work && LD_LIBRARY_PATH=/work LD_PRELOAD=/work/libc.so.6 exec {program} "$@"'

    def alone(words, code=0):
        return run([shutil.which("chroot"), root, "/bin/sh", "-c", start, "sh", *words.split()], code, env={})

    for words, code, made in FIRST:
        alone(words, code)
        assert made is None or (root / "work" / made).exists(), words
    [told] = json.loads(alone("info points.vdb --json"))["files"]
    assert len(told["grids"]) == 1, told


def test_the_image_has_the_packages_of_the_build():
    words = re.search(r'build_packages="(.*)"', (ROOT / "python" / "setup.sh").read_text()).group(1)
    image = (ROOT / "python" / "Dockerfile").read_text()
    assert f"    {words} \\\n" in image
    rust = re.search(r'^rust-version = "(.*)"', (ROOT / "Cargo.toml").read_text(), re.MULTILINE).group(1)
    assert f"FROM rust:{rust}-bookworm" in image
