"""Starts the process that cuts the motors when the app does not any more, and keeps telling it that the app is alive.

The kernel's PWM goes on when the process that has set it is killed or hangs, and systemd needs some 10 to 100 ms to
see a death and two seconds to see a hanging. A pipe that loses its writer is seen at once.
"""

from __future__ import annotations

import contextlib
import os
import resource
import select
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from robot_app.drivers.base import DeviceError
from robot_app.drivers.guardian import program

SILENCE_S = 0.06  # the motor is set every 0.02 s; a cut for nothing lasts until the next setting
_PRIORITY = 60  # above all tasks of the schedule: it computes for microseconds
_STARTS_WITHIN_S = 5.0
_ENDS_WITHIN_S = 1.0


@dataclass(frozen=True, slots=True)
class Will:
    """What is to brake the car when the app is gone: a pulse of the first motor, and the levels of its two lines."""

    push_ns: int
    levels: tuple[bool, bool]


class Guardian:
    """`duty_files`: a zero in each of them cuts the motors. `lines_fd`: of the direction lines of the first, where the
    guardian shall brake. Raises `DeviceError` where nothing guards them.
    """

    def __init__(self, duty_files: Sequence[Path], lines_fd: int | None = None) -> None:
        self._alive_fd: int | None = None
        lines = program.NO_LINES if lines_fd is None else lines_fd
        arguments = (SILENCE_S, _priority(), lines, *duty_files)
        command = [sys.executable, "-I", "-S", "-B", program.__file__, *map(str, arguments)]
        reading, writing = os.pipe()
        try:
            self._process = subprocess.Popen(
                command,
                stdin=reading,
                stdout=subprocess.PIPE,
                pass_fds=() if lines_fd is None else (lines_fd,),
                start_new_session=True,  # Ctrl-C is for the app
            )
        except OSError as error:
            os.close(writing)
            raise DeviceError(f"drive: the process that guards the motors does not start: {error}") from error
        finally:
            os.close(reading)
        os.set_blocking(writing, False)
        self._alive_fd = writing
        self._await_ready()

    @property
    def process_id(self) -> int:
        return self._process.pid

    def alive(self, will: Will | None = None) -> None:
        """The app is about to set the motors. Raises `DeviceError` when the guardian has ended: nothing moves then."""
        if self._alive_fd is None:
            raise DeviceError("drive: is closed")
        try:
            os.write(self._alive_fd, _record(will))
        except BlockingIOError:
            return  # the pipe is full of such records
        except OSError as error:
            raise DeviceError("drive: the process that guards the motors has ended; start the app again") from error

    def close(self) -> None:
        """It cuts the motors once more and ends."""
        fd, self._alive_fd = self._alive_fd, None
        if fd is None:
            return
        os.close(fd)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_ENDS_WITHIN_S)
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait(_ENDS_WITHIN_S)
        if self._process.stdout is not None:
            self._process.stdout.close()

    def _await_ready(self) -> None:
        answer = self._process.stdout
        assert answer is not None
        ready = select.select([answer], [], [], _STARTS_WITHIN_S)[0]
        if not ready or os.read(answer.fileno(), 1) != program.READY:
            self.close()
            raise DeviceError("drive: the process that guards the motors does not start")


def _record(will: Will | None) -> bytes:
    if will is None:
        return program.WILL.pack(0, 0)
    return program.WILL.pack(will.push_ns, sum(high << i for i, high in enumerate(will.levels)))


def _priority() -> int:
    """0 where the limits permit none."""
    limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    return _PRIORITY if limit == resource.RLIM_INFINITY or limit >= _PRIORITY else 0
