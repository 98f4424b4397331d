#!/bin/sh
# Runs the tests that tests/run.sh leaves out: slow ones of the crates and of the Python package, examples in
# documentation, and the golden pictures on further Vulkan drivers, if VOXSPLAT_TEST_DRIVERS names them as
# tests/drivers.sh does: "NAME=ICD.json NAME=ICD.json".
# With --part N/M it runs every M-th of the slow tests of the crates, from number N on, and those of the Python package
# if N is 0: 0/8 to 7/8 run all.
set -eu
cd "$(dirname "$0")/.."
# shellcheck source=tests/setup.sh
. ./tests/setup.sh
# shellcheck source=tests/progress.sh
. ./tests/progress.sh

slow_part=0 slow_parts=1
if [ "${1:-}" = --part ]; then
    slow_part=${2%/*} slow_parts=${2#*/}
fi
if [ "$slow_part" = 0 ]; then
    progress_say "1 of 4: slow tests of the Python package"
    sh tests/python.sh --slow -m slow
fi
progress_say "2 of 4: examples in documentation"
cargo test --workspace --doc --locked
progress_say "3 of 4: golden pictures on further drivers"
if [ -n "${VOXSPLAT_TEST_DRIVERS:-}" ]; then
    # shellcheck disable=SC2086 # one word per driver
    sh tests/drivers.sh $VOXSPLAT_TEST_DRIVERS -- --test suite golden::
else
    progress_say "skipped: VOXSPLAT_TEST_DRIVERS names no driver"
fi
progress_say "4 of 4: slow tests of the crates"
progress_slow "$slow_part" "$slow_parts"
