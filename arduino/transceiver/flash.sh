#!/bin/sh
# Uploads the firmware through the Mega's own boot loader. Called by `make flash-transceiver PORT=/dev/ttyACM0`.
set -eu
HERE=$(dirname "$0")
HEX=${HEX:-$HERE/../../build/transceiver/transceiver.hex}
PORT=${PORT:-}

fail() {
    echo "flash-transceiver: $1" >&2
    exit 1
}

command -v avrdude >/dev/null || fail "avrdude is missing; install it: sudo apt-get install avrdude"
if [ -z "$PORT" ]; then
    found=$(ls /dev/ttyACM* /dev/ttyUSB* 2>/dev/null | tr '\n' ' ' || true)
    fail "say where the Mega is: make flash-transceiver PORT=/dev/ttyACM0 (there is: ${found:-no serial port})"
fi
[ -e "$PORT" ] || fail "there is no $PORT; is the Mega plugged in?"
[ -r "$PORT" ] && [ -w "$PORT" ] ||
    fail "$PORT may not be opened; add yourself to its group: sudo usermod -a -G dialout \$USER, then log in again"
[ -f "$HEX" ] || fail "there is no $HEX; run: make firmware"
log=$(mktemp)
trap 'rm -f "$log"' EXIT
avrdude -p atmega2560 -c wiring -P "$PORT" -b 115200 -D -U "flash:w:$HEX:i" >"$log" 2>&1 || {
    cat "$log" >&2
    fail "avrdude could not write to the board at $PORT; is it a Mega 2560, and does no other program have it open?"
}
echo "flash-transceiver: written to $PORT and verified"
