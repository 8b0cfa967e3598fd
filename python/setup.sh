#!/usr/bin/env bash
# Makes this machine ready: Debian packages that are missing, and the Python environments under .venvs/.
#
#   python/setup.sh [build] [bpy] [usd] [mitsuba] [imaging] [torch] [wheel] [mpi] [dist] [debian] [bench]
#
# All but debian and bench when none is named.
#
# What is there already is left alone, so a second run does nothing; an environment counts as there
# only when its stamp, written last, names the same requirements, so an interrupted install is redone.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# OpenVDB with what its headers need, and libclang for bindgen; its tools and Python module serve the
# tests and the fixtures.
build_packages="g++ make libopenvdb-dev libboost-dev libclang-dev libopenvdb-tools python3-openvdb"
# Blender opens these even without a display.
bpy_packages="libx11-6 libxrender1 libxfixes3 libxi6 libxkbcommon0 libxext6 libsm6 libice6 libgl1"

# MRI of heads, as images to convert; NanoVDB's own converter; videos.
imaging_packages="mricron-data libnanovdb-tools ffmpeg"

# MPI, with which the program for clusters is linked.
mpi_packages="libopenmpi-dev openmpi-bin libclang-dev"

# A system without any library, in which the archive is tried; other releases of Debian.
dist_packages="xz-utils busybox-static"
debian_packages="debootstrap"

# What compares volumes, and compiles OpenVDB's side of the comparison; the MRI of a head.
bench_packages="$build_packages python3-numpy mricron-data"

PATH=$PATH:${HOME:-/root}/.cargo/bin

say() { printf '%s\n' "$*" >&2; }
die() { say "error: $*"; exit 2; }

# Networks fail now and then: three tries, a pause between them.
retry() {
    local try
    for try in 1 2 3; do
        "$@" && return 0
        [ "$try" = 3 ] || { say "that failed (try $try of 3): $*"; sleep $((5 * try)); }
    done
    return 1
}

missing_packages() {
    local package
    for package in "$@"; do
        dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q '^install ok installed$' || printf '%s ' "$package"
    done
}

install_packages() {
    if ! command -v dpkg-query >/dev/null; then
        say "note: no Debian packages here; the build needs the counterparts of: $*"
        return 0
    fi
    local missing
    missing=$(missing_packages "$@")
    [ -n "$missing" ] || return 0
    local as_root
    if [ "$(id -u)" = 0 ]; then
        as_root=""
    elif command -v sudo >/dev/null && { sudo -n true 2>/dev/null || [ -t 0 ]; }; then
        as_root="sudo"
    else
        die "these Debian packages are missing and need root to install:
    apt-get install --no-install-recommends $missing
Have them installed, then run this again."
    fi
    say "installing Debian packages: $missing"
    # shellcheck disable=SC2086  # both are lists of words
    {
        retry $as_root apt-get update -qq || say "note: the package lists could not be refreshed; trying with those at hand"
        retry $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing >&2 ||
            die "apt-get could not install: $missing"
    }
}

# The first interpreter of a wanted version that can make environments (`3` takes any).
find_python() {
    local candidate
    for candidate in "python$1" python3 /usr/bin/python3; do
        "$candidate" - "$1" 2>/dev/null <<'PY' && { command -v "$candidate"; return 0; }
import ensurepip, sys, venv
wanted = [int(part) for part in sys.argv[1].split(".")]
sys.exit(list(sys.version_info[: len(wanted)]) != wanted)
PY
    done
    return 1
}

# make_environment NAME PYTHON_VERSION IMPORT
make_environment() {
    local name=$1 version=$2 module=$3
    local folder=.venvs/$name requirements=python/requirements-$1.txt
    local stamp=$folder/complete wanted
    wanted="$(sha256sum <"$requirements") $PWD"
    if [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$wanted" ] && [ -x "$folder/bin/python" ]; then
        return 0
    fi
    local python
    python=$(find_python "$version") || {
        install_packages python3 python3-venv
        python=$(find_python "$version") ||
            die "the environment $name needs Python $version with venv and ensurepip; install it and put python$version on PATH"
    }
    say "making $folder (${requirements}, $("$python" --version))"
    rm -rf "$folder"
    "$python" -m venv "$folder"
    retry "$folder/bin/python" -m pip install --disable-pip-version-check --quiet --requirement "$requirements" ||
        die "pip could not install $requirements into $folder; check the network and run this again"
    "$folder/bin/python" -c "import $module" ||
        die "$folder was installed but 'import $module' fails in it; its message stands above"
    printf '%s\n' "$wanted" >"$stamp"
}

[ $# -gt 0 ] || set -- build bpy usd mitsuba imaging torch wheel mpi dist
# One set-up at a time: two would tear down each other's environments.
mkdir -p .venvs
if command -v flock >/dev/null; then
    exec 9>.venvs/lock
    flock 9
fi
for part in "$@"; do
    case $part in
    build)
        # shellcheck disable=SC2086
        install_packages $build_packages
        command -v cargo >/dev/null || die "cargo is not on PATH; install Rust from https://rustup.rs, then run this again"
        ;;
    bpy)
        # shellcheck disable=SC2086
        install_packages $bpy_packages
        make_environment bpy 3.11 bpy
        ;;
    usd) make_environment usd 3 pxr.Usd ;;
    mitsuba) make_environment mitsuba 3 mitsuba ;;
    imaging)
        # shellcheck disable=SC2086
        install_packages $imaging_packages
        make_environment imaging 3 SimpleITK
        ;;
    torch) make_environment torch 3 torch ;;
    wheel) make_environment wheel 3 maturin ;;
    mpi)
        # shellcheck disable=SC2086
        install_packages $mpi_packages
        ;;
    dist)
        # shellcheck disable=SC2086
        install_packages $dist_packages
        ;;
    debian)
        # shellcheck disable=SC2086
        install_packages $debian_packages
        ;;
    bench)
        # shellcheck disable=SC2086
        install_packages $bench_packages
        make_environment bench 3 numba
        ;;
    *) die "unknown part '$part'; give build, bpy, usd, mitsuba, imaging, torch, wheel, mpi, dist, debian or bench" ;;
    esac
done
