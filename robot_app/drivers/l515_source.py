"""Where the depth camera's frames come from: this process, or one of their own (l515_process.py)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from robot_app.drivers.base import DeviceError
from robot_app.drivers.camera_process.program import DepthPipeline, Lens
from robot_app.drivers.config import DepthCameraConfig
from robot_app.drivers.library import load_library


@dataclass(frozen=True, slots=True, eq=False)
class Fetched:
    """`device_s`: the camera's own time; `waited_s`: since the frame came; `depth`: (H, W), the caller's own."""

    device_s: float
    waited_s: float
    depth: NDArray[np.uint16]


class FrameSource(Protocol):
    """`start` may be called again after `stop`. All but `stop` raise `DeviceError`."""

    @property
    def where(self) -> str:
        """Which process reads the camera, as a phrase."""
        ...

    def start(self) -> None: ...

    def lens(self, timeout_s: float) -> Lens | None:
        """After `start`, until it is known."""
        ...

    def fetch(self, timeout_s: float) -> Fetched | None:
        """The newest frame, once."""
        ...

    def stop(self, reset: bool) -> None:
        """`reset`: a camera that sends nothing is reset on its way out."""
        ...


class InProcess:
    """pyrealsense2 imported by the app itself."""

    where = "this process"

    def __init__(self, config: DepthCameraConfig, name: str) -> None:
        self._config = config
        self._name = name
        self._pipeline = DepthPipeline(_library(name))
        self._lens: Lens | None = None

    def start(self) -> None:
        c = self._config
        try:
            self._lens = self._pipeline.start(c.serial, c.width, c.height, c.rate_hz)
        except RuntimeError as error:
            raise DeviceError(f"{self._name}: {advice(str(error))}") from error

    def lens(self, timeout_s: float) -> Lens | None:
        return self._lens

    def fetch(self, timeout_s: float) -> Fetched | None:
        try:
            frame = self._pipeline.fetch(max(1, round(timeout_s * 1000)))
        except RuntimeError as error:
            raise DeviceError(f"{self._name}: lost: {error}") from error
        if frame is None:
            return None
        return Fetched(frame.device_ms * 1e-3, 0.0, np.array(frame.data, np.uint16, copy=True))

    def stop(self, reset: bool) -> None:
        self._pipeline.stop(reset)


def _library(name: str) -> Any:
    try:
        return load_library("pyrealsense2", name)
    except DeviceError as error:
        raise DeviceError(f"{error}; or set devices.camera.interpreter to a Python that has it") from error


def advice(text: str) -> str:
    """What to do when librealsense does not start and says `text`."""
    if "No device connected" in text:
        return "is not found; is it plugged into a blue USB 3 port? From 2.55 on pyrealsense2 knows no L515"
    if "resolve requests" in text:
        return "cannot send depth in this size and rate; on USB 2 the L515 has only 320 x 240: use a blue USB 3 port"
    if "busy" in text.lower():
        return "another program uses it"
    return text
