#!/bin/sh
# Makes the packages as a release does, and tries them outside of the repository: the crates from their archives, the
# wheel and its source archive in fresh environments of Python, the image if a container runtime runs.
# Takes 20 minutes on two cores, so .ci/run leaves it to the workflows. Everything lies in target/packages.
set -eu
cd "$(dirname "$0")/.."
# shellcheck disable=SC2034 # read by the next line
setup_driver=no
# shellcheck source=tests/setup.sh
. ./tests/setup.sh

say() {
    echo "packages: $*" >&2
}

version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
work=$PWD/target/packages
rm -rf "$work/crates" "$work/install" "$work/dist" "$work/try"
mkdir -p "$work/crates" "$work/dist"

say "1 of 4: crates"
cargo package --workspace --exclude voxsplat-python --exclude voxsplat-suite --locked --no-verify --allow-dirty --quiet
for crate in voxsplat voxsplat-cli voxsplat-volume; do
    tar -xzf "target/package/$crate-$version.crate" -C "$work/crates"
    for file in README.md LICENSE-MIT LICENSE-APACHE; do
        [ -s "$work/crates/$crate-$version/$file" ] || setup_fail "$crate lacks $file"
    done
    # It lies in the folder of the workspace, and is none of it.
    printf '\n[workspace]\n' >>"$work/crates/$crate-$version/Cargo.toml"
done
# As from crates.io, with the archives in place of what is not published: its lock file has other sources then.
cargo install --quiet --path "$work/crates/voxsplat-cli-$version" --root "$work/install" \
    --target-dir "$work/target" \
    --config "patch.crates-io.voxsplat.path=\"$work/crates/voxsplat-$version\"" \
    --config "patch.crates-io.voxsplat-volume.path=\"$work/crates/voxsplat-volume-$version\""
"$work/install/bin/voxsplat" render demo:sphere:32 -o "$work/sphere.png" --size 64

say "2 of 4: the wheel"
[ -x "$work/tools/bin/maturin" ] || {
    python3 -m venv "$work/tools"
    "$work/tools/bin/pip" install --quiet --disable-pip-version-check 'maturin>=1.16,<2' ziglang
}
PATH=$work/tools/bin:$PATH
maturin build --quiet --release --locked --zig --compatibility manylinux_2_28 --manifest-path python/Cargo.toml \
    --target-dir "$work/target" --out "$work/dist"
maturin sdist --manifest-path python/Cargo.toml --out "$work/dist"
if find "$work/dist" -name '*.whl' -size +12000k | grep .; then setup_fail "the wheel has over 12 MB"; fi

# Installs a package in a fresh environment, and tries it without a driver.
try() {
    rm -rf "$work/try"
    python3 -m venv "$work/try"
    CARGO_TARGET_DIR="$work/target" "$work/try/bin/pip" install --quiet --disable-pip-version-check "$1"
    (
        export VK_DRIVER_FILES=/none.json VK_ICD_FILENAMES=/none.json
        cd "$work" && try/bin/python ../../python/tests/installed.py
    )
}
try "$work"/dist/*.whl
say "3 of 4: the source archive of the wheel"
try "$work"/dist/*.tar.gz

say "4 of 4: the image"
if docker info >/dev/null 2>&1; then
    docker build --quiet --tag voxsplat:packages --file examples/docker/Dockerfile .
    docker run --rm --user "$(id -u)" --volume "$work:/data" voxsplat:packages \
        render demo:sphere:32 -o image.png --size 64
    [ -s "$work/image.png" ] || setup_fail "the image rendered nothing"
else
    say "skipped: no container runtime answers"
fi
ls -l "$work/dist" "$work/install/bin"
