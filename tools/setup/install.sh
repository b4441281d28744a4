#!/bin/sh
# Makes the virtual environment and installs everything the station, the simulator and the tests need.
set -eu
PYTHON=${PYTHON:-python3}
VENV=${VENV:-.venv}
HERE=$(dirname "$0")

fail() {
    echo "setup: $1" >&2
    exit 1
}

command -v "$PYTHON" >/dev/null || fail "there is no $PYTHON; install Python 3.11 or newer, or name one: make PYTHON=python3.12"
"$PYTHON" -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
    fail "$("$PYTHON" --version) is too old; Python 3.11 or newer is needed: make PYTHON=python3.12"

missing=""
if command -v dpkg-query >/dev/null && command -v apt-get >/dev/null; then
    for package in $(cat "$HERE/system-packages.txt"); do
        # A package may have been renamed; one that provides the old name will do.
        dpkg-query -W -f '${db:Status-Status} ${Package} ${Provides}\n' 2>/dev/null |
            grep -Eq "^installed (.*[ ,])?$(echo "$package" | sed 's/[.+]/\\&/g')([ ,(]|$)" || missing="$missing $package"
    done
    "$PYTHON" -c 'import ensurepip, venv' 2>/dev/null || missing="$missing python3-venv"
else
    echo "setup: this is no Debian; make sure that these libraries are there: $(tr '\n' ' ' <"$HERE/system-packages.txt")"
fi

if [ -n "$missing" ]; then
    command="apt-get install -y --no-install-recommends$missing"
    if [ "$(id -u)" = 0 ]; then
        as_root=""
    elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
        as_root="sudo"
    else
        fail "system packages are missing. Run this once, then try again:
    sudo $command"
    fi
    echo "setup: installing system packages:$missing"
    export DEBIAN_FRONTEND=noninteractive
    $as_root apt-get update -qq || echo "setup: the package lists could not be refreshed; trying with the old ones"
    $as_root $command >/dev/null || fail "this failed: $as_root $command"
fi

[ -x "$VENV/bin/python" ] || { echo "setup: making $VENV"; "$PYTHON" -m venv "$VENV"; }
echo "setup: installing Python packages into $VENV (a minute or two the first time)"
"$VENV/bin/python" -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/workstation.lock ||
    fail "the Python packages of requirements/workstation.lock could not be installed; is the network there?"
"$VENV/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable . ||
    fail "the project itself could not be installed into $VENV"
touch "$VENV/.ready"
echo "setup: done"
