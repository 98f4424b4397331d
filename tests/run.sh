#!/bin/sh
# Runs every test, including slow ones: of the Python package (tests/python.sh), then of the crates. Installs missing
# packages other than Rust first. Arguments replace the default arguments of `cargo test`, and skip Python.
set -eu
cd "$(dirname "$0")/.."
# shellcheck source=tests/setup.sh
. ./tests/setup.sh
if [ $# -eq 0 ]; then
    sh tests/python.sh
    set -- -- --include-ignored
fi
# The same packages as tests/python.sh builds: their features, and so their dependencies, are compiled once.
cargo test --workspace --locked "$@"
