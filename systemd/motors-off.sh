#!/bin/sh
# Cuts the motor and lets the servo go: every exported PWM channel gets duty 0 and is switched off.
# Shell, for it has to be through in milliseconds, whatever happened to the app before. SYS is for its test.
status=0
for channel in "${SYS:-/sys}"/class/pwm/pwmchip*/pwm[0-9]*; do
    [ -d "$channel" ] || continue
    for file in duty_cycle enable; do
        # The kernel refuses even a zero for a channel that was exported and never set up: it is off all the same.
        echo 0 2>/dev/null >"$channel/$file" || [ "$(cat "$channel/enable" 2>/dev/null)" = 0 ] ||
            { echo "motors-off: cannot write $channel/$file" >&2; status=1; }
    done
done
exit "$status"
