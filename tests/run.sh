#!/bin/sh
# Runs every test, the slow ones too, installing first what is missing besides Rust.
# Arguments replace those that `cargo test` is given.
set -eu
cd "$(dirname "$0")/.."
# shellcheck source=tests/setup.sh
. ./tests/setup.sh
[ $# -gt 0 ] || set -- -- --include-ignored
cargo test --features hdf5 --locked "$@"
