#!/bin/sh
# Builds the transceiver's firmware and says what it takes of the Mega. Called by `make firmware`.
set -eu
HERE=$(dirname "$0")
BUILD=${BUILD:-$HERE/../../build/transceiver}
PYTHON=${PYTHON:-python3}

fail() {
    echo "firmware: $1" >&2
    exit 1
}

command -v avr-gcc >/dev/null || fail "avr-gcc is missing; install it: sudo apt-get install gcc-avr avr-libc"
command -v make >/dev/null || fail "make is missing; install it: sudo apt-get install make"
mkdir -p "$BUILD"
BUILD=$(cd "$BUILD" && pwd)
(cd "$HERE/../.." && "$PYTHON" -m tools.gen_protocol) || fail "the protocol's header could not be written"
make -s -C "$HERE" BUILD="$BUILD" firmware || fail "the firmware does not compile"
avr-size -A "$BUILD/transceiver.elf" | awk -v hex="$BUILD/transceiver.hex" '
    $1 == ".text" || $1 == ".data" { flash += $2 }
    $1 == ".data" || $1 == ".bss" || $1 == ".noinit" { ram += $2 }
    END {
        printf "firmware: %s\n", hex
        printf "firmware: flash %d of 253952 bytes (%.1f %%), RAM %d of 8192 bytes (%.1f %%), the rest is stack\n",
            flash, 100 * flash / 253952, ram, 100 * ram / 8192
    }'
