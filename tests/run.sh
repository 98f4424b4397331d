#!/bin/sh
# Runs every test, including slow ones. Installs missing packages other than Rust first.
# Arguments replace the default arguments of `cargo test`.
set -eu
cd "$(dirname "$0")/.."
# shellcheck source=tests/setup.sh
. ./tests/setup.sh
[ $# -gt 0 ] || set -- -- --include-ignored
cargo test --features hdf5 --locked "$@"
