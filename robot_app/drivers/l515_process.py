"""The depth camera read by a process of its own, for an app whose Python has no pyrealsense2 that knows the L515."""

from __future__ import annotations

import contextlib
import fcntl
import math
import mmap
import os
import socket
import struct
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robot_app.drivers.base import DeviceError
from robot_app.drivers.camera_process import program
from robot_app.drivers.camera_process.program import Lens
from robot_app.drivers.config import DepthCameraConfig
from robot_app.drivers.l515_source import Fetched, advice
from shared.runtime.clock import Clock

_PROGRAM = str(Path(program.__file__).resolve())
_STARTS_WITHIN_S = 12.0  # Python and librealsense come from a slow card, and the camera wakes up
_ENDS_WITHIN_S = 2.0  # it stops the camera first
_WAY_S = 0.003  # an answer takes at most so long on its way
_STALE_S = 0.15  # an answer that is late by so much brings a frame of no use
_LATEST_MS = 1e14  # of a time stamp since 1970, far from now
_SEALS = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL


@dataclass(slots=True)
class _Request:
    number: int
    asked_s: float
    wait_s: float


class CameraProcess:
    """Asks for one frame after the other; `program` tells how. A lost camera gets a new process.

    The memory has no name, so nothing stays behind however the app ends, and it is sealed: a process that shrank it
    would kill the app. What the process says is checked, and one wrong word ends it.
    """

    def __init__(self, config: DepthCameraConfig, name: str, clock: Clock) -> None:
        self._config = config
        self._name = name
        self._clock = clock
        self._size = config.width * config.height * 2
        self._process: subprocess.Popen[bytes] | None = None
        self._channel: socket.socket | None = None
        self._memory: mmap.mmap | None = None
        self._lens: Lens | None = None
        self._request: _Request | None = None
        self._number = 0
        self._start_by_s = 0.0

    @property
    def where(self) -> str:
        return f"a process of {self._config.interpreter}"

    def start(self) -> None:
        if self._process is not None and self._process.poll() is None:  # it waits in the kernel for the camera
            raise DeviceError(f"{self._name}: its process {self._process.pid} does not end; unplug the camera")
        self._lens = self._request = None
        self._start_by_s = self._clock.now_s() + _STARTS_WITHIN_S
        memory_fd = os.memfd_create("camera", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        try:
            os.ftruncate(memory_fd, self._size)
            fcntl.fcntl(memory_fd, fcntl.F_ADD_SEALS, _SEALS)
            self._memory = mmap.mmap(memory_fd, self._size, mmap.MAP_SHARED, mmap.PROT_READ)
            self._spawn(memory_fd)
        except OSError as error:
            remedy = "sudo sh systemd/install.sh installs one" if isinstance(error, FileNotFoundError) else str(error)
            raise DeviceError(
                f"{self._name}: devices.camera.interpreter {self._config.interpreter} cannot be started: {remedy}"
            ) from error
        finally:
            os.close(memory_fd)

    def lens(self, timeout_s: float) -> Lens | None:
        if self._lens is None:
            answer = self._receive(timeout_s)
            if answer is not None:
                self._lens = self._started(answer)
            elif self._clock.now_s() > self._start_by_s:
                raise DeviceError(f"{self._name}: its process does not start")
        return self._lens

    def fetch(self, timeout_s: float) -> Fetched | None:
        until_s = self._clock.now_s() + timeout_s
        if self._request is not None:  # its answer was not there when the last call ended
            fetched = self._answer(self._request, timeout_s)
            if fetched is not None or self._request is not None:
                return fetched
        left_s = until_s - self._clock.now_s()
        return self._answer(self._ask(left_s - _WAY_S), left_s)

    def _answer(self, request: _Request, timeout_s: float) -> Fetched | None:
        answer = self._receive(timeout_s)
        late_s = self._clock.now_s() - request.asked_s - request.wait_s
        if answer is None:
            if late_s > self._config.silence_s / 2:  # sooner than the camera's own silence
                raise DeviceError(f"{self._name}: its process hangs")
            return None
        self._request = None
        fetched = self._fetched(answer, request.number)
        if fetched is None or late_s > _STALE_S:
            return None
        return Fetched(fetched.device_s, max(0.0, late_s), fetched.depth)

    def stop(self, reset: bool) -> None:
        channel, self._channel = self._channel, None
        memory, self._memory = self._memory, None
        if channel is not None:
            with contextlib.suppress(OSError):  # it has ended
                if reset:
                    channel.send(program.REQUEST.pack(0, program.RESET_MS))
                channel.shutdown(socket.SHUT_WR)
        self._end()
        if channel is not None:
            channel.close()
        if memory is not None:
            memory.close()

    def _spawn(self, memory_fd: int) -> None:
        c = self._config
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        camera = [c.serial, str(c.width), str(c.height), str(c.rate_hz)]
        with theirs:
            self._process = subprocess.Popen(
                [c.interpreter, "-B", _PROGRAM, str(theirs.fileno()), str(memory_fd), *camera],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                pass_fds=(theirs.fileno(), memory_fd),
                start_new_session=True,  # Ctrl-C is for the app, which ends it in order
            )

    def _end(self) -> None:
        """It stops the camera and ends when nobody can ask any more; one that does not is killed."""
        process = self._process
        if process is None:
            return
        for _ in range(2):
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(_ENDS_WITHIN_S)
                self._process = None
                return
            process.kill()

    def _ask(self, wait_s: float) -> _Request:
        self._number += 1
        wait_ms = max(1, round(wait_s * 1000))
        request = _Request(self._number, self._clock.now_s(), wait_ms * 1e-3)
        try:
            self._open_channel().send(program.REQUEST.pack(request.number, wait_ms))
        except OSError as error:
            raise self._ended() from error
        self._request = request
        return request

    def _receive(self, timeout_s: float) -> bytes | None:
        channel = self._open_channel()
        try:
            channel.settimeout(max(0.001, timeout_s))
            answer = channel.recv(program.LONGEST_MESSAGE)
        except TimeoutError:
            return None
        except OSError as error:
            raise self._ended() from error
        if not answer:
            raise self._ended()
        if answer[0] == program.KIND_LOST:
            text = _words(answer[1:])
            raise DeviceError(f"{self._name}: {advice(text) if self._lens is None else f'lost: {text}'}")
        return answer

    def _open_channel(self) -> socket.socket:
        if self._channel is None:
            raise DeviceError(f"{self._name}: is closed")
        return self._channel

    def _ended(self) -> DeviceError:
        return DeviceError(f"{self._name}: its process has ended")

    def _started(self, answer: bytes) -> Lens:
        head, model = answer[: program.STARTED.size], answer[program.STARTED.size :]
        kind, width, height, *numbers = self._unpacked(program.STARTED, head)
        fx, fy, ppx, ppy, unit_m = numbers
        shape = self._config.width, self._config.height
        whole = kind == program.KIND_STARTED and (width, height) == shape and all(map(math.isfinite, numbers))
        if not whole or min(fx, fy, unit_m) <= 0:
            raise DeviceError(f"{self._name}: its process sends garbage")
        return Lens(_words(model), unit_m, width, height, fx, fy, ppx, ppy)

    def _fetched(self, answer: bytes, number: int) -> Fetched | None:
        if answer[0] == program.KIND_NOTHING:
            _, answered = self._unpacked(program.NOTHING, answer)
            if answered == number:
                return None
        elif answer[0] == program.KIND_FRAME:
            _, answered, _, device_ms, size = self._unpacked(program.FRAME, answer)
            right = (answered, size) == (number, self._size) and 0 <= device_ms < _LATEST_MS
            if right and self._memory is not None:
                depth = np.frombuffer(self._memory[:], np.uint16)
                return Fetched(device_ms * 1e-3, 0.0, depth.reshape(self._config.height, self._config.width))
        raise DeviceError(f"{self._name}: its process sends garbage")

    def _unpacked(self, layout: struct.Struct, message: bytes) -> tuple[Any, ...]:
        try:
            return layout.unpack(message)
        except struct.error as error:
            raise DeviceError(f"{self._name}: its process sends garbage") from error


def _words(text: bytes) -> str:
    """One line without what a terminal obeys."""
    return "".join(c if c.isprintable() else " " for c in text.decode("utf-8", "replace"))
