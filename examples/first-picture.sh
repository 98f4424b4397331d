#!/bin/sh
# Builds voxsplat and renders a built-in volume. Installs a missing C linker first; Rust must be there. Without a GPU
# the processor draws, so no driver is needed.
set -eu
cd "$(dirname "$0")/.."
# shellcheck disable=SC2034 # read by the next line
setup_driver=no
# shellcheck source=tests/setup.sh
. ./tests/setup.sh
picture=target/first-picture.png
cargo build --release --locked
target/release/voxsplat render demo:nautilus -o "$picture"
echo "The picture is in $PWD/$picture"
