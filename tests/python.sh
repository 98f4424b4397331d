#!/bin/sh
# Runs the tests of the Python package (python/tests) with the program and the native module of the test build. Installs
# what is missing: python3-venv with apt, and the pinned packages of python/tests/requirements.txt into target/python.
# Skipped with a line if the machine cannot have Python 3.11 or later, but never in CI (CI is set).
# Arguments go to pytest: sh tests/python.sh -k masks
# With --slow as the first argument slow tests run too, with the packages of requirements-slow.txt: clusters of Dask,
# MPI, napari and mypy.
set -eu
cd "$(dirname "$0")/.."
# shellcheck source=tests/setup.sh
. ./tests/setup.sh

python_skip() {
    [ -z "${CI:-}" ] || setup_fail "$*: CI must run the tests of Python"
    echo "python: tests skipped: $*" >&2
    exit 0
}

# The oldest version that pyproject.toml supports.
python_works() {
    "$1" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1
}

python=
for name in python3 python3.14 python3.13 python3.12 python3.11; do
    if python_works "$name"; then python=$name && break; fi
done
if [ -z "$python" ]; then
    command -v apt-get >/dev/null 2>&1 || python_skip "there is no Python 3.11 with venv, and no apt-get"
    (setup_install python3-venv) || python_skip "apt-get could not install python3-venv"
    python=python3
    python_works "$python" || python_skip "$(python3 --version 2>&1) is older than 3.11"
fi

# Installs the packages of python/tests/$1.txt, unless they are there.
python_packages() {
    list=python/tests/$1.txt
    if ! cmp -s "$list" "$venv/$1.txt"; then
        echo "python: installing the packages of $list" >&2
        "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --requirement "$list" ||
            python_skip "pip could not install the packages of $list"
        cp "$list" "$venv/$1.txt"
    fi
}

# The virtual environment belongs to one Python and one list of packages.
venv=target/python/venv
if ! cmp -s python/tests/requirements.txt "$venv/requirements.txt" || ! python_works "$venv/bin/python"; then
    rm -rf "$venv"
    "$python" -m venv "$venv"
fi
python_packages requirements
if [ "${1:-}" = --slow ]; then
    shift
    python_packages requirements-slow
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
