#!/bin/sh
# numba keeps compiled kernels beside their source and looks at that file alone: a kernel that calls one of another
# file keeps running the old one when only the other was edited. So all are made anew when any kernel has changed.
set -eu
VENV=${VENV:-.venv}
STAMP=$VENV/.kernels
FOLDERS="shared robot_app station_gui tools"
if [ ! -e "$STAMP" ] || [ -n "$(find $FOLDERS -name '*.py' -newer "$STAMP" -exec grep -l 'njit' {} + | head -n 1)" ]; then
    find $FOLDERS \( -name '*.nbi' -o -name '*.nbc' \) -delete
    "$VENV/bin/python" -m tools.compile_kernels
    touch "$STAMP"
fi
