#!/bin/sh
# Renders the pictures of the guide into docs/, except lights.png and presets.png, which show scans, and
# beside.png, which docs/beside.py draws.
set -e
cd "$(dirname "$0")/.."
cargo build --release --locked

picture() {
    name=$1
    shift
    target/release/voxsplat render "$@" -o "docs/$name.png" --size "${pixels:-320}"
}

surface="--transfer examples/surface.json --light headlight --azimuth 30 --elevation 45"
# shellcheck disable=SC2086
picture lit-voxels demo:marschner-lobb:96 $surface
# shellcheck disable=SC2086
picture post-lit demo:marschner-lobb:96 $surface --shading post
# shellcheck disable=SC2086
picture blurred demo:marschner-lobb:40 $surface --shading post
# shellcheck disable=SC2086
picture sharp demo:marschner-lobb:40 $surface --shading post --sharpness 1
# shellcheck disable=SC2086
picture shadows demo:marschner-lobb:96 ${surface%--light*} --light 90,30:1.5 --shadows on --light-size 8 \
    --azimuth 30 --elevation 45
picture studio demo:vessels:160 --light studio --azimuth 30 --elevation 10
picture narrow-pre demo:shell:96 --azimuth 30 --elevation 20
picture narrow-post demo:shell:96 --azimuth 30 --elevation 20 --shading post
picture xray demo:shepp-logan:160 --model xray --azimuth 20 --elevation 10
picture film demo:shepp-logan:160 --model xray --response film --azimuth 20 --elevation 10
picture mip demo:vessels:160 --model mip --kernel kaiser-bessel --transfer inferno --azimuth 30 --elevation 10
picture depth-coded demo:vessels:160 --model mip --depth-coded --kernel kaiser-bessel --transfer grayscale \
    --azimuth 30 --elevation 10
picture attenuated demo:vessels:160 --model mip --attenuation 0.7 --kernel kaiser-bessel --transfer inferno \
    --azimuth 30 --elevation 10
picture cut demo:shepp-logan:160 --clip 1,1,0 --light studio --azimuth -20 --elevation 25
# Pictures that are compared have one size.
picture axis demo:marschner-lobb:48 --frame visible --tune sheets=axis --azimuth 44.8 --elevation 20
additive="--frame visible --tune sheets=axis,accumulate=additive"
# shellcheck disable=SC2086
picture additive demo:marschner-lobb:48 $additive --azimuth 44.9 --elevation 20
# shellcheck disable=SC2086
picture additive-after demo:marschner-lobb:48 $additive --azimuth 45.1 --elevation 20
target/release/voxsplat compare docs/additive.png docs/additive-after.png --tolerance 1 --difference docs/pop.png
rm docs/additive-after.png
cargo run --release --locked --example solids -- docs/solids.png
picture inside demo:vessels:192 --light 40,50 --light headlight --projection perspective --fov 70 --distance 30 \
    --target 0,0,20
pixels=480 picture vessels demo:vessels:192
pixels=480 picture shepp-logan demo:shepp-logan:96
pixels=512 picture figure demo:vessels:128 --azimuth 30 --elevation 20 --background white \
    --scale-bar --axes --colour-bar --title 'A vessel tree' --caption 'demo:vessels:128, parallel rays'
pixels=40 picture minified demo:vessels:256 --light headlight --azimuth 30 --elevation 10
pixels=40 picture aliased demo:vessels:256 --light headlight --azimuth 30 --elevation 10 --tune antialiasing=off
