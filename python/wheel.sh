#!/usr/bin/env bash
# Makes target/wheels/cumulo-VERSION-cp311-abi3-manylinux_*.whl: the package with OpenVDB, and what that needs, inside.
# It serves CPython 3.11 and later on systems whose glibc is as new as the one here, or newer.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
python/setup.sh build wheel
PATH=$PWD/.venvs/wheel/bin:$PATH:${HOME:-/root}/.cargo/bin
cargo build --release --locked -p cumulo -p cumulo-python

# The licenses of the libraries that come along.
licenses=python/cumulo/licenses
rm -rf "$licenses" target/wheels
trap 'rm -rf "$licenses"' EXIT
mapfile -t libraries < <(ldd target/release/lib_native.so | awk '$2 == "=>" {print $3}')
python/licenses.sh "$licenses" "${libraries[@]}"

(cd python && maturin build --release --locked --auditwheel repair --out ../target/wheels --target-dir ../target)
ls -l target/wheels >&2
