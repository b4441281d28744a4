"""Run by itself: `program.py SILENCE_S PRIORITY FILE…`. Knows nothing but the standard library, to be small.

Each byte on its standard input says that the app is alive. When none comes for `SILENCE_S`, and when the app has ended,
however it ended, a zero is written into each file: the duty of a motor.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys

READY = b"r"
_APP, _ANSWER = 0, 1  # file descriptors
_CHUNK = 65_536


def _cut(files: list[int]) -> None:
    for file in files:
        with contextlib.suppress(OSError):  # the others must be written whatever happens to this one
            os.pwrite(file, b"0\n", 0)


def guard(silence_s: float, files: list[int]) -> None:
    """Returns once the app has ended and the motors are cut."""
    while True:
        if not select.select([_APP], [], [], silence_s)[0]:
            _cut(files)
        elif not os.read(_APP, _CHUNK):
            _cut(files)
            return


def main() -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # it ends after the app, never before
    silence_s, priority = float(sys.argv[1]), int(sys.argv[2])
    files = [os.open(name, os.O_WRONLY) for name in sys.argv[3:]]
    if priority:
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    os.write(_ANSWER, READY)
    guard(silence_s, files)


if __name__ == "__main__":
    main()
