"""Depth images of an Intel RealSense L515, or of a D400, through pyrealsense2."""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np

from robot_app.drivers.arrival import ArrivalFilter
from robot_app.drivers.base import DepthImage, DeviceError
from robot_app.drivers.config import DepthCameraConfig
from robot_app.drivers.library import load_library
from robot_app.drivers.lost import Reopening
from shared.geometry.camera import Intrinsics
from shared.runtime.clock import Clock


class RealSenseCamera:
    """The newest frame only: the pipeline keeps one and drops those that nobody fetched.

    The stamp is the arrival, freed of the host's delays by the camera's own time stamps, less `latency_s`.
    """

    def __init__(self, config: DepthCameraConfig, clock: Clock) -> None:
        self._config = config
        self._clock = clock
        self._name = f"depth camera {config.serial}".rstrip()
        self._realsense: Any = load_library("pyrealsense2", self._name)
        self._reopening = Reopening(clock, config.reopen_every_s)
        self._closed = False
        self._pipeline: Any = None
        self._start()

    @property
    def intrinsics(self) -> Intrinsics:
        return self._intrinsics

    @property
    def model(self) -> str:
        return self._model

    def read(self, timeout_s: float) -> DepthImage | None:
        """After a loss the read raises `DeviceError`, and a later one starts the camera again."""
        if self._closed:
            raise DeviceError(f"{self._name}: is closed")
        self._reopening.check_due()
        try:
            if self._pipeline is None:
                self._restart()
            image = self._fetch(timeout_s)
        except DeviceError as error:
            self._drop()
            self._reopening.lost(error)
            raise
        if image is None:
            self._reopening.check_found()
        else:
            self._reopening.found()
        return image

    def close(self) -> None:
        self._closed = True
        self._drop()

    def _start(self) -> None:
        rs, c = self._realsense, self._config
        pipeline, request = rs.pipeline(), rs.config()
        if c.serial:
            request.enable_device(c.serial)
        request.enable_stream(rs.stream.depth, c.width, c.height, rs.format.z16, c.rate_hz)
        try:
            profile = pipeline.start(request)
            self._pipeline = pipeline
            device = profile.get_device()
            self._model = str(device.get_info(rs.camera_info.name))
            self._unit_m = float(device.first_depth_sensor().get_depth_scale())
            lens = profile.get_stream(rs.stream.depth).as_video_stream_profile().get_intrinsics()
        except RuntimeError as error:
            self._drop()
            raise DeviceError(f"{self._name}: {_advice(str(error))}") from error
        # librealsense has the centre of pixel (0, 0) at (0, 0), we have it at (0.5, 0.5).
        centre = lens.ppx + 0.5, lens.ppy + 0.5
        self._intrinsics = Intrinsics(lens.width, lens.height, lens.fx, lens.fy, *centre)
        self._arrival = ArrivalFilter()
        self._last_number = -1
        self._last_read_s = self._clock.now_s()
        self._frame_by_s = self._last_read_s + c.start_up_s

    def _restart(self) -> None:
        before = self._intrinsics
        self._start()
        if self._intrinsics != before:
            self._intrinsics = before
            raise DeviceError(f"{self._name}: another camera is connected; start the app again")

    def _drop(self) -> None:
        pipeline, self._pipeline = self._pipeline, None
        if pipeline is not None:
            with contextlib.suppress(RuntimeError):  # it has lost its device
                pipeline.stop()

    def _fetch(self, timeout_s: float) -> DepthImage | None:
        try:
            came, frames = self._pipeline.try_wait_for_frames(max(1, round(timeout_s * 1000)))
            frame = frames.get_depth_frame() if came else None
            arrived_s = self._clock.now_s()
            if not frame or frame.get_frame_number() == self._last_number:
                self._check_silence(arrived_s)
                return None
            return self._image(frame, arrived_s)
        except RuntimeError as error:
            raise DeviceError(f"{self._name}: lost: {error}") from error

    def _image(self, frame: Any, arrived_s: float) -> DepthImage:
        self._last_number = frame.get_frame_number()
        self._last_read_s = arrived_s
        self._frame_by_s = arrived_s + self._config.silence_s
        depth = np.array(frame.get_data(), np.uint16, copy=True)  # the frame's memory is used again
        depth.setflags(write=False)
        stamp_s = self._arrival.arrival_s(frame.get_timestamp() * 1e-3, arrived_s) - self._config.latency_s
        return DepthImage(stamp_s, depth, self._unit_m)

    def _check_silence(self, now_s: float) -> None:
        """Time in which nobody listened is not the camera's silence."""
        if now_s - self._last_read_s > self._config.silence_s / 2:
            self._frame_by_s = max(self._frame_by_s, now_s + self._config.silence_s / 2)
        self._last_read_s = now_s
        if now_s > self._frame_by_s:
            raise DeviceError(f"{self._name}: sends no frames; is it plugged into a blue USB 3 port?")


def _advice(text: str) -> str:
    if "No device connected" in text:
        return "is not found; is it plugged into a blue USB 3 port? From 2.55 on pyrealsense2 knows no L515"
    if "resolve requests" in text:
        return "cannot send depth in this size and rate; on USB 2 the L515 has only 320 x 240: use a blue USB 3 port"
    if "busy" in text.lower():
        return "another program uses it"
    return text
