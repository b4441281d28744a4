"""As much of pyrealsense2 as the driver uses, with a camera whose frames a test gives."""

from __future__ import annotations

from collections import deque
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Camera:
    """The pipeline keeps the newest frame only. `fault`: what librealsense says when it is started."""

    def __init__(self, depth_scale: float = 0.00025) -> None:
        self.depth_scale = depth_scale
        self.lens = SimpleNamespace(width=640, height=480, fx=457.0, fy=461.0, ppx=319.5, ppy=239.5)
        self.fault: str | None = None
        self.serial = "f0000001"
        self.is_lost = False
        self.starts = 0
        self.stops = 0
        self.resets = 0
        self.requested: list[tuple[Any, ...]] = []
        self._frames: deque[_Frame] = deque(maxlen=1)
        self._number = 0

    def send(self, depth: NDArray[np.uint16], timestamp_ms: float) -> None:
        self._number += 1
        self._frames.append(_Frame(depth, timestamp_ms, self._number))

    def reset(self) -> None:
        self.resets += 1

    @property
    def is_absent(self) -> bool:
        return self.is_lost or self.fault == "No device connected"

    def take(self) -> _Frame | None:
        return self._frames.popleft() if self._frames else None

    def library(self) -> SimpleNamespace:
        return SimpleNamespace(
            pipeline=lambda: _Pipeline(self),
            config=lambda: _Config(self),
            stream=SimpleNamespace(depth="depth"),
            format=SimpleNamespace(z16="z16"),
            camera_info=SimpleNamespace(name="name", serial_number="serial number"),
            context=lambda: SimpleNamespace(query_devices=lambda: [] if self.is_absent else [_Listed(self)]),
            pipeline_wrapper=lambda pipeline: pipeline,
        )


class _Listed:
    """A camera as the list of all has it."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera

    def get_info(self, what: str) -> str:
        return self._camera.serial if what == "serial number" else "Intel RealSense L515"


class _Frame:
    def __init__(self, depth: NDArray[np.uint16], timestamp_ms: float, number: int) -> None:
        self._depth, self._timestamp_ms, self._number = depth, timestamp_ms, number

    def get_depth_frame(self) -> _Frame:
        return self

    def get_data(self) -> NDArray[np.uint16]:
        return self._depth

    def get_timestamp(self) -> float:
        return self._timestamp_ms

    def get_frame_number(self) -> int:
        return self._number


class _Config:
    def __init__(self, camera: Camera) -> None:
        self._camera = camera

    def enable_device(self, serial: str) -> None:
        self._camera.requested.append((serial,))

    def enable_stream(self, *stream: Any) -> None:
        self._camera.requested.append(stream)

    def can_resolve(self, _pipeline: Any) -> bool:
        wanted = {request[0] for request in self._camera.requested if len(request) == 1}
        return self._camera.fault is None and not self._camera.is_lost and wanted <= {self._camera.serial}


class _Pipeline:
    def __init__(self, camera: Camera) -> None:
        self._camera = camera

    def start(self, config: _Config) -> SimpleNamespace:
        camera = self._camera
        if camera.is_lost or camera.fault is not None:
            raise RuntimeError(camera.fault or "No device connected")
        camera.starts += 1
        sensor = SimpleNamespace(get_depth_scale=lambda: camera.depth_scale)
        device = SimpleNamespace(
            first_depth_sensor=lambda: sensor, get_info=lambda _: "Intel RealSense L515", hardware_reset=camera.reset
        )
        video = SimpleNamespace(get_intrinsics=lambda: camera.lens)
        stream = SimpleNamespace(as_video_stream_profile=lambda: video)
        return SimpleNamespace(get_device=lambda: device, get_stream=lambda _: stream)

    def try_wait_for_frames(self, timeout_ms: int) -> tuple[bool, _Frame | None]:
        if self._camera.is_lost:
            raise RuntimeError("Device disconnected. Failed to recconect: No device connected")
        frame = self._camera.take()
        return frame is not None, frame

    def stop(self) -> None:
        self._camera.stops += 1
        if self._camera.is_lost:
            raise RuntimeError("stop() cannot be called before start()")
