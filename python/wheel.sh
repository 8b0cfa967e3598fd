#!/usr/bin/env bash
# Makes target/wheels/cumulo-VERSION-cp311-abi3-manylinux_*.whl: the package with OpenVDB, and what that needs, inside.
# It serves CPython 3.11 and later on systems whose glibc is as new as the one here, or newer.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
python/setup.sh build wheel
rm -rf target/wheels
cd python
PATH=$PWD/../.venvs/wheel/bin:$PATH
../.venvs/wheel/bin/maturin build --release --locked --auditwheel repair --out ../target/wheels --target-dir ../target
ls -l ../target/wheels >&2
