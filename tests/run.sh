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
# Mesa's software driver 22.3.6 crashes once in thousands of pictures of `quads` (docs/hard-cases.md, Drivers), but not
# without threads of its own. Tests run side by side anyway. Those of Python, above, keep the threads.
LP_NUM_THREADS=${LP_NUM_THREADS:-0}
export LP_NUM_THREADS
# The same packages as tests/python.sh builds: their features, and so their dependencies, are compiled once.
cargo test --workspace --locked "$@"
