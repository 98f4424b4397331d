#!/bin/sh
# Builds voxsplat and renders a built-in volume. Installs missing packages other than Rust first.
set -eu
cd "$(dirname "$0")/.."
# shellcheck source=tests/setup.sh
. ./tests/setup.sh
picture=target/first-picture.png
cargo build --release --locked
target/release/voxsplat render demo:nautilus -o "$picture"
echo "The picture is in $PWD/$picture"
