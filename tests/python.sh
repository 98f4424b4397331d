#!/bin/sh
# Runs the tests of the Python package (python/tests) with the program and the native module of the test build. Installs
# what is missing: python3-venv with apt, and the pinned packages of python/tests/requirements.txt into target/python.
# Skipped with a line if the machine cannot have Python 3.11 or later, but never in CI (CI is set).
# Arguments go to pytest: sh tests/python.sh -k masks
# With --slow as the first argument slow tests run too, with the packages of requirements-slow.txt: clusters of Dask,
# MPI, napari, JupyterLab in Chromium, which apt installs, and mypy.
set -eu
cd "$(dirname "$0")/.."
# shellcheck source=tests/setup.sh
. ./tests/setup.sh

venv=target/python/venv
setup_venv python "$venv" python/tests/requirements.txt
if [ "${1:-}" = --slow ]; then
    shift
    setup_pip python "$venv" python/tests/requirements-slow.txt
    if ! command -v chromium >/dev/null && ! command -v google-chrome >/dev/null; then setup_install chromium; fi
    export VOXSPLAT_SLOW_TESTS=1
fi

# With the flags of tests/run.sh, so that nothing is compiled twice.
cargo build --workspace --lib --bins --tests --locked
package=target/python/package
rm -rf "$package"
mkdir -p "$package"
cp -r python/voxsplat "$package/"
for native in target/debug/lib_native.so target/debug/lib_native.dylib; do
    if [ -f "$native" ]; then cp "$native" "$package/voxsplat/_native.abi3.so"; fi
done
cd python/tests
PYTHONPATH=../../$package PYTHONDONTWRITEBYTECODE=1 ../../$venv/bin/pytest -q -c ../pyproject.toml "$@"
