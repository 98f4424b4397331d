#!/bin/sh
# Builds the site of the guide from docs/ into target/site/html; a warning of MkDocs, such as a link that leads nowhere,
# is an error. Installs what is missing: python3-venv with apt, and the pinned packages of docs/requirements.txt into
# target/site. Skipped with a line if the machine cannot have Python 3.11 or later, but never in CI (CI is set).
# Arguments go to `mkdocs build`.
set -eu
cd "$(dirname "$0")/.."

site_skip() {
    if [ -n "${CI:-}" ]; then
        echo "site: $*: CI must build the site" >&2
        exit 1
    fi
    echo "site: not built: $*" >&2
    exit 0
}

site_python_works() {
    "$1" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1
}

python=
for name in python3 python3.14 python3.13 python3.12 python3.11; do
    if site_python_works "$name"; then python=$name && break; fi
done
if [ -z "$python" ]; then
    command -v apt-get >/dev/null 2>&1 || site_skip "there is no Python 3.11 with venv, and no apt-get"
    # shellcheck source=tests/setup.sh
    (setup_driver=no && . ./tests/setup.sh && setup_install python3-venv) ||
        site_skip "apt-get could not install python3-venv"
    python=python3
    site_python_works "$python" || site_skip "$(python3 --version 2>&1) is older than 3.11"
fi

# The virtual environment belongs to one Python and one list of packages.
venv=target/site/venv
if ! cmp -s docs/requirements.txt "$venv/requirements.txt" || ! site_python_works "$venv/bin/python"; then
    echo "site: installing the packages of docs/requirements.txt" >&2
    rm -rf "$venv"
    "$python" -m venv "$venv"
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --requirement docs/requirements.txt ||
        site_skip "pip could not install the packages of docs/requirements.txt"
    cp docs/requirements.txt "$venv/requirements.txt"
fi

PYTHONDONTWRITEBYTECODE=1 "$venv/bin/mkdocs" build --strict "$@"
echo "site: target/site/html/index.html" >&2
