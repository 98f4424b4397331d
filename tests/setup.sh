# Sourced by the scripts of this repository, from its root: installs packages that a fresh Debian or Ubuntu lacks
# besides Rust: a C linker and, unless setup_driver=no, Mesa's Vulkan driver, which needs no GPU, with its loader.
# Silent if nothing is missing.
# shellcheck shell=sh

setup_fail() {
    echo "setup: $*" >&2
    exit 1
}

# Whether C programs can be linked: a compiler without the C library's headers and start files is not enough.
setup_can_link() {
    command -v cc >/dev/null 2>&1 || return 1
    setup_dir=$(mktemp -d) || return 1
    echo '#include <stdlib.h>
int main(void) { return EXIT_SUCCESS; }' >"$setup_dir/try.c"
    setup_rc=0
    cc "$setup_dir/try.c" -o "$setup_dir/try" >/dev/null 2>&1 || setup_rc=1
    rm -rf "$setup_dir"
    return $setup_rc
}

# Whether a driver manifest names an existing library: by path, or by a name that the dynamic linker knows.
setup_icd_works() {
    [ -f "$1" ] || return 1
    setup_lib=$(sed -n 's/.*"library_path"[[:space:]]*:[[:space:]]*"\([^"]*\)".*/\1/p' "$1" | head -n 1)
    case $setup_lib in
        '') return 1 ;;
        /*) [ -f "$setup_lib" ] ;;
        */*) [ -f "$(dirname "$1")/$setup_lib" ] ;;
        *) printf '%s\n' "$setup_libraries" | grep -qF "$setup_lib" ;;
    esac
}

# Whether Vulkan's loader and at least one driver are installed. macOS and Windows render without either.
setup_has_vulkan() {
    [ "$(uname -s)" = Linux ] || return 0
    # ldconfig lies outside the PATH of ordinary users.
    setup_libraries=$(PATH="$PATH:/usr/sbin:/sbin" ldconfig -p 2>/dev/null)
    printf '%s\n' "$setup_libraries" | grep -q 'libvulkan\.so\.1' || return 1
    setup_named=${VK_DRIVER_FILES:-${VK_ICD_FILENAMES:-}}
    if [ -n "$setup_named" ]; then
        # Named drivers replace all others, so installing one would not help: the user must correct a wrong name.
        setup_ifs=$IFS
        IFS=:
        for setup_icd in $setup_named; do
            if setup_icd_works "$setup_icd"; then
                IFS=$setup_ifs
                return 0
            fi
        done
        IFS=$setup_ifs
        setup_fail "VK_DRIVER_FILES or VK_ICD_FILENAMES names no driver that works: $setup_named"
    fi
    for setup_icd in /usr/share/vulkan/icd.d/*.json /usr/local/share/vulkan/icd.d/*.json \
        /etc/vulkan/icd.d/*.json /usr/local/etc/vulkan/icd.d/*.json \
        "${XDG_DATA_HOME:-$HOME/.local/share}"/vulkan/icd.d/*.json; do
        if setup_icd_works "$setup_icd"; then return 0; fi
    done
    return 1
}

setup_install() {
    command -v apt-get >/dev/null 2>&1 ||
        setup_fail "missing: $*; there is no apt-get: install them by hand"
    if [ "$(id -u)" -eq 0 ]; then
        setup_root='env'
    elif command -v sudo >/dev/null 2>&1; then
        setup_root='sudo env'
    else
        setup_fail "missing: $*; run as root: apt-get update && apt-get install --no-install-recommends $*"
    fi
    echo "setup: installing $*" >&2
    # The package lists of a fresh image are empty or old.
    setup_log=$(mktemp) || setup_fail "cannot make a temporary file"
    if ! { $setup_root apt-get -qq update &&
        $setup_root DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends "$@"; } \
        >"$setup_log" 2>&1; then
        cat "$setup_log" >&2
        rm -f "$setup_log"
        setup_fail "apt-get could not install $*"
    fi
    rm -f "$setup_log"
}

# The oldest version that the Python package supports.
setup_python_works() {
    "$1" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1
}

# Ends a script that needs Python with a line that begins with its name $1; in CI (CI is set) as a failure.
setup_skip() {
    [ -z "${CI:-}" ] || setup_fail "$*: CI may not skip this"
    echo "$1: skipped: $2" >&2
    exit 0
}

# Makes the virtual environment $2 with the pinned packages of the list $3, unless it is there. A script of the name $1
# is skipped if the machine cannot have Python 3.11.
setup_venv() {
    if cmp -s "$3" "$2/$(basename "$3")" && setup_python_works "$2/bin/python"; then return; fi
    setup_python=
    for setup_name in python3 python3.14 python3.13 python3.12 python3.11; do
        if setup_python_works "$setup_name"; then setup_python=$setup_name && break; fi
    done
    if [ -z "$setup_python" ]; then
        command -v apt-get >/dev/null 2>&1 || setup_skip "$1" "there is no Python 3.11 with venv, and no apt-get"
        (setup_install python3-venv) || setup_skip "$1" "apt-get could not install python3-venv"
        setup_python=python3
        setup_python_works python3 || setup_skip "$1" "$(python3 --version 2>&1) is older than 3.11"
    fi
    rm -rf "$2"
    "$setup_python" -m venv "$2"
    setup_pip "$1" "$2" "$3"
}

# Installs the pinned packages of the list $3 into the virtual environment $2, unless they are there.
setup_pip() {
    if cmp -s "$3" "$2/$(basename "$3")"; then return; fi
    echo "$1: installing the packages of $3" >&2
    "$2/bin/python" -m pip install --quiet --disable-pip-version-check --requirement "$3" ||
        setup_skip "$1" "pip could not install the packages of $3"
    cp "$3" "$2/"
}

# rustup adds its directory to the PATH of new shells only.
if ! command -v cargo >/dev/null 2>&1 && [ -f "${CARGO_HOME:-$HOME/.cargo}/env" ]; then
    # shellcheck source=/dev/null
    . "${CARGO_HOME:-$HOME/.cargo}/env"
fi
command -v cargo >/dev/null 2>&1 || setup_fail "Rust is missing: install it from https://rustup.rs"

# The library is compiled on one core for a third of a build, and needs metadata of the others alone. With a job more
# than there are cores it begins earlier: 8 % less time on two cores.
setup_jobs=$(($(getconf _NPROCESSORS_ONLN) + 1))
export CARGO_BUILD_JOBS="${CARGO_BUILD_JOBS:-$setup_jobs}"

setup_packages=
setup_can_link || setup_packages="gcc libc6-dev"
setup_lacks_driver() {
    [ "${setup_driver:-yes}" = yes ] && ! setup_has_vulkan
}
setup_lacks_driver && setup_packages="$setup_packages libvulkan1 mesa-vulkan-drivers"
if [ -n "$setup_packages" ]; then
    # shellcheck disable=SC2086 # one word per package
    setup_install $setup_packages
    setup_can_link || setup_fail "C programs still do not link"
    if setup_lacks_driver; then setup_fail "there is still no working Vulkan driver"; fi
fi
