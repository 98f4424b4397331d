#!/bin/sh
# Builds the site of the guide from docs/ into target/site/html; a warning of MkDocs, such as a link that leads nowhere,
# is an error. Installs what is missing: python3-venv with apt, and the pinned packages of docs/requirements.txt into
# target/site. Skipped with a line if the machine cannot have Python 3.11 or later, but never in CI (CI is set).
# Arguments go to `mkdocs build`.
set -eu
cd "$(dirname "$0")/.."

# shellcheck disable=SC2034 # read by the next line
setup_driver=no
# shellcheck source=tests/setup.sh
. ./tests/setup.sh

venv=target/site/venv
setup_venv site "$venv" docs/requirements.txt
PYTHONDONTWRITEBYTECODE=1 "$venv/bin/mkdocs" build --strict --config-file .ci/mkdocs.yml "$@"
echo "site: target/site/html/index.html" >&2
