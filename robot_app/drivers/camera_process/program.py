"""Depth frames through pyrealsense2, and the process that fetches them for an app whose Python has no pyrealsense2.

librealsense 2.54.2 is the last that knows the L515, and on aarch64 its wheels end at Python 3.9. This file therefore
runs under Python 3.9 and imports the standard library and pyrealsense2 only. The app starts it with

    python program.py SOCKET MEMORY SERIAL WIDTH HEIGHT RATE

SOCKET and MEMORY are open file descriptors: a SOCK_SEQPACKET pair and a memory of WIDTH x HEIGHT x 2 bytes. The
process writes the memory only between a request and its answer and the app reads it only after the answer, so no frame
is torn, and no frame is older than the request for it. The process ends with the socket, that is with the app.
"""

from __future__ import annotations

import contextlib
import mmap
import signal
import socket
import struct
import sys
from typing import Any, NamedTuple

REQUEST = struct.Struct("<QI")  # number, longest wait in ms; RESET_MS: reset the camera and end
RESET_MS = 0
STARTED = struct.Struct("<BIIddddd")  # kind, width, height, fx, fy, ppx, ppy, m per unit; the model's name follows
FRAME = struct.Struct("<BQQdI")  # kind, number of the request, number of the frame, camera's time in ms, bytes
NOTHING = struct.Struct("<BQ")  # kind, number of the request
KIND_STARTED, KIND_FRAME, KIND_NOTHING, KIND_LOST = 1, 2, 3, 4  # KIND_LOST: a text follows
LONGEST_MESSAGE = 512
_HANGS_AFTER_S = 15  # a library call that takes so long never comes back


class Lens(NamedTuple):
    """As librealsense has it: the centre of pixel (0, 0) is (0, 0)."""

    model: str
    unit_m: float
    width: int
    height: int
    fx: float
    fy: float
    ppx: float
    ppy: float


class Frame(NamedTuple):
    """`data`: (height, width) uint16, in memory that librealsense uses again."""

    number: int
    device_ms: float
    data: Any


class DepthPipeline:
    """librealsense's pipeline keeps the newest frame and drops those that nobody fetched. Raises RuntimeError."""

    def __init__(self, realsense: Any) -> None:
        self._realsense = realsense
        self._pipeline: Any = None
        self._device: Any = None
        self._last_number = -1

    def start(self, serial: str, width: int, height: int, rate_hz: int) -> Lens:
        rs = self._realsense
        pipeline, request = rs.pipeline(), rs.config()
        if serial:
            request.enable_device(serial)
        request.enable_stream(rs.stream.depth, width, height, rs.format.z16, rate_hz)
        if not (request.can_resolve(rs.pipeline_wrapper(pipeline)) or self._is_there(serial)):
            raise RuntimeError("No device connected")  # librealsense would say so after waiting 15 s for one
        profile = pipeline.start(request)
        self._pipeline, self._device, self._last_number = pipeline, profile.get_device(), -1
        lens = profile.get_stream(rs.stream.depth).as_video_stream_profile().get_intrinsics()
        model = str(self._device.get_info(rs.camera_info.name))
        unit_m = float(self._device.first_depth_sensor().get_depth_scale())
        return Lens(model, unit_m, lens.width, lens.height, lens.fx, lens.fy, lens.ppx, lens.ppy)

    def _is_there(self, serial: str) -> bool:
        info = self._realsense.camera_info.serial_number
        devices = self._realsense.context().query_devices()
        return any(not serial or device.get_info(info) == serial for device in devices)

    def fetch(self, timeout_ms: int) -> Frame | None:
        """None: no frame came in time that was not fetched before."""
        came, frames = self._pipeline.try_wait_for_frames(timeout_ms)
        frame = frames.get_depth_frame() if came else None
        if not frame or frame.get_frame_number() == self._last_number:
            return None
        self._last_number = frame.get_frame_number()
        return Frame(self._last_number, frame.get_timestamp(), frame.get_data())

    def stop(self, reset: bool) -> None:
        """`reset`: as if its cable were pulled and plugged; it is away for some seconds."""
        pipeline, self._pipeline = self._pipeline, None
        device, self._device = self._device, None
        if device is not None and reset:
            with contextlib.suppress(RuntimeError):
                device.hardware_reset()
        if pipeline is not None:
            with contextlib.suppress(RuntimeError):  # it has lost its device
                pipeline.stop()


def _answer(pipeline: DepthPipeline, number: int, timeout_ms: int, memory: mmap.mmap) -> bytes:
    frame = pipeline.fetch(timeout_ms)
    if frame is None:
        return NOTHING.pack(KIND_NOTHING, number)
    data = memoryview(frame.data).cast("B")
    if len(data) != len(memory):
        raise RuntimeError(f"a frame has {len(data)} bytes instead of {len(memory)}")
    memory[:] = data
    return FRAME.pack(KIND_FRAME, number, frame.number, frame.device_ms, len(data))


def _serve(channel: socket.socket, memory: mmap.mmap, serial: str, shape: tuple[int, int, int]) -> None:
    try:
        import pyrealsense2  # noqa: PLC0415 - the app reads this file without it
    except ImportError as error:
        raise RuntimeError(f"{sys.executable}: {error}; run: {sys.executable} -m pip install pyrealsense2") from error

    pipeline = DepthPipeline(pyrealsense2)
    reset = False
    try:
        model, unit_m, *lens = pipeline.start(serial, *shape)
        channel.send(STARTED.pack(KIND_STARTED, *lens, unit_m) + model.encode()[:64])
        while not reset:
            signal.alarm(0)  # the app may take its time
            request = channel.recv(LONGEST_MESSAGE)
            if not request:
                return
            number, timeout_ms = REQUEST.unpack(request)
            signal.alarm(_HANGS_AFTER_S)
            reset = timeout_ms == RESET_MS
            if not reset:
                channel.send(_answer(pipeline, number, timeout_ms, memory))
    finally:
        signal.alarm(_HANGS_AFTER_S)
        pipeline.stop(reset)


def main(arguments: list[str]) -> int:
    socket_fd, memory_fd, serial, width, height, rate_hz = arguments
    signal.alarm(_HANGS_AFTER_S)  # ends the process even where a library call holds the interpreter
    shape = int(width), int(height), int(rate_hz)
    size = shape[0] * shape[1] * 2
    with socket.socket(fileno=int(socket_fd)) as channel, mmap.mmap(int(memory_fd), size) as memory:
        try:
            _serve(channel, memory, serial, shape)
        except OSError:  # the app has gone
            return 0
        except RuntimeError as error:
            with contextlib.suppress(OSError):
                channel.send(bytes([KIND_LOST]) + str(error).encode()[: LONGEST_MESSAGE - 1])
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
