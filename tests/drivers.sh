#!/bin/sh
# Runs the tests with other Vulkan drivers, one after the other: sh tests/drivers.sh NAME=ICD.json...
# NAME is a part of the adapter's name, ICD.json the driver's manifest. Arguments after -- go to `cargo test`.
# If a driver needs its own libraries, set LD_LIBRARY_PATH.
#
#     sh tests/drivers.sh llvmpipe=/usr/share/vulkan/icd.d/lvp_icd.x86_64.json SwiftShader=$HOME/swiftshader/icd.json
set -eu
cd "$(dirname "$0")/.."
drivers=
while [ $# -gt 0 ]; do
    case $1 in
        --) shift; break ;;
        ?*=?*) drivers="$drivers $1"; shift ;;
        *) echo "drivers: $1 is not NAME=ICD.json" >&2; exit 2 ;;
    esac
done
[ -n "$drivers" ] || { sed -n '2,6s/^# \{0,1\}//p' "$0" >&2; exit 2; }
failed=
for driver in $drivers; do
    name=${driver%%=*} icd=${driver#*=}
    [ -f "$icd" ] || { echo "drivers: there is no file $icd" >&2; exit 2; }
    echo "drivers: $name by $icd"
    # Loaders before 1.3.207 know only the second name.
    env "VK_DRIVER_FILES=$icd" "VK_ICD_FILENAMES=$icd" "VOXSPLAT_TEST_ADAPTER=$name" sh tests/run.sh "$@" ||
        failed="$failed $name"
done
[ -z "$failed" ] || { echo "drivers: tests fail with$failed" >&2; exit 1; }
