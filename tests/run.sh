#!/bin/sh
# Runs every test, installing first what is missing besides Rust. Arguments go to `cargo test`.
set -eu
cd "$(dirname "$0")/.."
# shellcheck source=tests/setup.sh
. ./tests/setup.sh
cargo test --locked "$@"
