#!/bin/sh
# Runs the quick tests: of the Python package (tests/python.sh), then of the crates. Installs missing packages other
# than Rust first, and says how far it is. tests/slow.sh runs the other tests.
# Arguments go to `cargo test`, whose output is then left as it is: sh tests/run.sh --test suite golden::
set -eu
cd "$(dirname "$0")/.."
# shellcheck source=tests/setup.sh
. ./tests/setup.sh
# shellcheck source=tests/progress.sh
. ./tests/progress.sh

if [ $# -gt 0 ]; then
    export LP_NUM_THREADS="$progress_threads"
    exec cargo test --workspace --locked "$@"
fi
progress_say "1 of 3: compiling, about half of the time"
# shellcheck disable=SC2086 # one word per option
cargo test $progress_targets --no-run
progress_say "2 of 3: the Python package"
sh tests/python.sh
progress_say "3 of 3: the crates"
progress_quick
