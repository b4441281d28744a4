"""Run by itself: `program.py SILENCE_S PRIORITY LINES FILE…`. Knows nothing but the standard library, to be small.

Each record on its standard input says that the app is alive, and what is to be done when it is not any more. When none
comes for `SILENCE_S`, and when the app has ended, however it ended, a zero is written into each file: the duty of a
motor. Where the last record had a push, the bridge's direction lines, at the file descriptor LINES, are turned round
first and the push fades away in the first file: against the way, so that the car does not roll on.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import math
import os
import resource
import select
import signal
import struct
import sys

READY = b"r"
WILL = struct.Struct("<II")  # the push, in nanoseconds of a period, and the levels of the lines for it, bit by bit
NO_LINES = -1
SET_VALUES = 0xC010B40F  # GPIO_V2_LINE_SET_VALUES_IOCTL of linux/gpio.h …
LINE_VALUES = struct.Struct("<QQ")  # … and its struct gpio_v2_line_values: bits, mask
LINES = 0b11
FADES_S = 0.05  # the speed of a car with its motor cut fades in twice that time
_APP, _ANSWER = 0, 1  # file descriptors
_STEP_S, _STEPS = 0.005, 30
_CHUNK = 8192 * WILL.size
_MCL_CURRENT, _MCL_FUTURE = 1, 2  # linux/mman.h


class Motors:
    """`files`: open duty files; `lines`: the file descriptor of the direction lines of the first one's bridge."""

    def __init__(self, files: list[int], lines: int) -> None:
        self._files = files
        self._lines = lines

    def cut(self) -> None:
        for file in self._files:
            with contextlib.suppress(OSError):  # the others must be written whatever happens to this one
                os.pwrite(file, b"0\n", 0)

    def brake(self, push_ns: int, levels: int, app: int, app_is_gone: bool) -> None:
        """Ends as soon as the app is there again; it sets lines and duty anew."""
        self.cut()
        if not push_ns or self._lines == NO_LINES:
            return
        with contextlib.suppress(OSError):  # without the lines, or the duty, it stays cut
            self._turn_round(levels)
            for step in range(_STEPS):
                os.pwrite(self._files[0], b"%d\n" % (push_ns * math.exp(-step * _STEP_S / FADES_S)), 0)
                if select.select([] if app_is_gone else [app], [], [], _STEP_S)[0]:
                    break
        self.cut()
        with contextlib.suppress(OSError):
            self._turn_round(0)

    def _turn_round(self, levels: int) -> None:
        fcntl.ioctl(self._lines, SET_VALUES, LINE_VALUES.pack(levels, LINES))


def guard(app: int, silence_s: float, motors: Motors) -> None:
    """Returns once the app has ended and the motors are cut. Each will is carried out once."""
    push_ns = levels = 0
    while True:
        if not select.select([app], [], [], silence_s)[0]:
            motors.brake(push_ns, levels, app, app_is_gone=False)
            push_ns = 0
            continue
        said = os.read(app, _CHUNK)
        if not said:
            motors.brake(push_ns, levels, app, app_is_gone=True)
            return
        if len(said) % WILL.size == 0:  # a record goes into the pipe as a whole
            push_ns, levels = WILL.unpack(said[-WILL.size :])


def _lock_memory() -> None:
    """All of it: what is to act when the computer runs out of memory must not wait for its own pages."""
    if resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY:
        ctypes.CDLL(None).mlockall(_MCL_CURRENT | _MCL_FUTURE)


def main() -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # it ends after the app, never before
    silence_s, priority, lines = float(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    motors = Motors([os.open(name, os.O_WRONLY) for name in sys.argv[4:]], lines)
    _lock_memory()
    if priority:
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    os.write(_ANSWER, READY)
    guard(_APP, silence_s, motors)


if __name__ == "__main__":
    main()
