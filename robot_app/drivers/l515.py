"""Depth images of an Intel RealSense L515, or of a D400, through pyrealsense2."""

from __future__ import annotations

from contextlib import ExitStack

from robot_app.drivers.arrival import ArrivalFilter
from robot_app.drivers.base import DepthImage, DeviceError
from robot_app.drivers.camera_process.program import Lens
from robot_app.drivers.config import DepthCameraConfig
from robot_app.drivers.l515_process import CameraProcess
from robot_app.drivers.l515_source import FrameSource, InProcess
from robot_app.drivers.lost import Reopening
from shared.geometry.camera import Intrinsics
from shared.runtime.clock import Clock

_LOOK_S = 0.2


class RealSenseCamera:
    """The newest frame only: librealsense keeps one and drops those that nobody fetched.

    Read in this process, or in one of its own when `interpreter` names a Python that has the library.
    The stamp is the arrival, freed of the host's delays by the camera's own time stamps, less `latency_s`.
    """

    def __init__(self, config: DepthCameraConfig, clock: Clock) -> None:
        self._config = config
        self._clock = clock
        self._name = f"depth camera {config.serial}".rstrip()
        self._source: FrameSource = (
            CameraProcess(config, self._name, clock) if config.interpreter else InProcess(config, self._name)
        )
        self._reopening = Reopening(clock, config.reopen_every_s)
        self._closed = False
        self._is_open = self._is_started = False
        self._silent = False
        self._intrinsics: Intrinsics | None = None
        with ExitStack() as opened:
            opened.callback(self._drop)
            self._open()
            while not self._is_started:
                self._look_for_start(_LOOK_S)
            opened.pop_all()

    @property
    def intrinsics(self) -> Intrinsics:
        assert self._intrinsics is not None
        return self._intrinsics

    @property
    def model(self) -> str:
        return self._model

    @property
    def where(self) -> str:
        """Which process reads the camera."""
        return self._source.where

    def read(self, timeout_s: float) -> DepthImage | None:
        """After a loss the read raises `DeviceError`, and a later one starts the camera again."""
        if self._closed:
            raise DeviceError(f"{self._name}: is closed")
        self._reopening.check_due()
        try:
            image = self._read(timeout_s)
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

    def _read(self, timeout_s: float) -> DepthImage | None:
        if not self._is_open:
            self._open()
        if not self._is_started:
            self._look_for_start(timeout_s)
        return self._fetch(timeout_s) if self._is_started else None

    def _open(self) -> None:
        self._is_open, self._is_started, self._silent = True, False, False
        self._source.start()

    def _look_for_start(self, timeout_s: float) -> None:
        lens = self._source.lens(timeout_s)
        if lens is None:
            return
        intrinsics = _intrinsics(lens)
        if self._intrinsics not in {None, intrinsics}:
            raise DeviceError(f"{self._name}: another camera is connected; start the app again")
        self._intrinsics, self._model, self._unit_m = intrinsics, lens.model, lens.unit_m
        self._arrival = ArrivalFilter()
        self._is_started = True
        self._last_read_s = self._clock.now_s()
        self._frame_by_s = self._last_read_s + self._config.start_up_s

    def _drop(self) -> None:
        if self._is_open:
            self._is_open = self._is_started = False
            self._source.stop(reset=self._silent)

    def _fetch(self, timeout_s: float) -> DepthImage | None:
        fetched = self._source.fetch(timeout_s)
        now_s = self._clock.now_s()
        if fetched is None:
            self._check_silence(now_s)
            return None
        arrived_s = self._arrival.arrival_s(fetched.device_s, now_s - fetched.waited_s)
        if now_s - arrived_s > self._config.silence_s:  # it waited, or the camera's clock was set
            self._check_silence(now_s)
            return None
        depth = fetched.depth
        if depth.shape != (self.intrinsics.height, self.intrinsics.width):
            raise DeviceError(f"{self._name}: sends images of another size than it told")
        self._last_read_s = now_s
        self._frame_by_s = now_s + self._config.silence_s
        depth.setflags(write=False)
        return DepthImage(arrived_s - self._config.latency_s, depth, self._unit_m)

    def _check_silence(self, now_s: float) -> None:
        """Time in which nobody listened is not the camera's silence."""
        if now_s - self._last_read_s > self._config.silence_s / 2:
            self._frame_by_s = max(self._frame_by_s, now_s + self._config.silence_s / 2)
        self._last_read_s = now_s
        if now_s > self._frame_by_s:
            self._silent = True
            raise DeviceError(f"{self._name}: sends no frames; is it plugged into a blue USB 3 port?")


def _intrinsics(lens: Lens) -> Intrinsics:
    """librealsense has the centre of pixel (0, 0) at (0, 0), we have it at (0.5, 0.5)."""
    return Intrinsics(lens.width, lens.height, lens.fx, lens.fy, lens.ppx + 0.5, lens.ppy + 0.5)
