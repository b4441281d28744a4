"""The camera's driver against a stand-in for pyrealsense2, which only the robot has installed."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from robot_app.drivers.base import DeviceError
from robot_app.drivers.config import DepthCameraConfig
from robot_app.drivers.l515 import RealSenseCamera
from shared.runtime.clock import ManualClock
from tools.simulator.devices.realsense import Camera

CONFIG = DepthCameraConfig()
DEPTH = np.arange(480 * 640, dtype=np.uint16).reshape(480, 640)


def test_a_frame_is_the_readers_own(camera: Camera) -> None:
    driver = RealSenseCamera(CONFIG, ManualClock(10.0))
    depth = DEPTH.copy()
    camera.send(depth, 5000.0)
    image = driver.read(0.01)
    assert image is not None
    depth[:] = 0  # the library uses its memory again
    np.testing.assert_array_equal(image.depth, DEPTH)
    assert image.unit_m == 0.00025
    assert image.stamp_s == pytest.approx(10.0 - CONFIG.latency_s)
    assert driver.read(0.01) is None
    driver.close()
    driver.close()
    assert camera.stops == 1


def test_only_the_newest_frame_is_read(camera: Camera) -> None:
    driver = RealSenseCamera(CONFIG, ManualClock())
    for i in range(5):
        camera.send(np.full_like(DEPTH, i), 33.0 * i)
    image = driver.read(0.01)
    assert image is not None
    assert image.depth[0, 0] == 4
    assert driver.read(0.01) is None


def test_a_frame_that_waited_keeps_its_stamp(camera: Camera) -> None:
    clock = ManualClock(10.0)
    driver = RealSenseCamera(CONFIG, clock)
    camera.send(DEPTH, 5000.0)
    first = driver.read(0.01)
    camera.send(DEPTH, 5033.0)
    clock.advance(0.090)
    second = driver.read(0.01)
    assert first is not None
    assert second is not None
    assert second.stamp_s - first.stamp_s == pytest.approx(0.033, abs=1e-3)


def test_scale_and_lens_are_the_devices(camera: Camera) -> None:
    camera.depth_scale = 0.001
    camera.serial = "f0123"
    driver = RealSenseCamera(DepthCameraConfig(serial="f0123"), ManualClock())
    lens = driver.intrinsics
    assert (lens.width, lens.height, lens.fx, lens.fy) == (640, 480, 457.0, 461.0)
    assert (lens.cx, lens.cy) == (320.0, 240.0)  # half a pixel from where librealsense counts
    assert camera.requested == [("f0123",), ("depth", 640, 480, "z16", 30)]


def test_an_unplugged_camera_is_an_error_and_comes_back(camera: Camera) -> None:
    clock = ManualClock()
    driver = RealSenseCamera(CONFIG, clock)
    camera.is_lost = True
    with pytest.raises(DeviceError, match="lost: Device disconnected"):
        driver.read(0.01)
    assert camera.resets == 0
    camera.fault = "No device connected"
    clock.advance(2.1)
    with pytest.raises(DeviceError, match="is not found; is it plugged into a blue USB 3 port"):
        driver.read(0.01)
    starts = camera.starts
    camera.is_lost, camera.fault = False, None
    with pytest.raises(DeviceError):  # too early for another try
        driver.read(0.01)
    assert camera.starts == starts
    clock.advance(2.1)
    with pytest.raises(DeviceError, match="not found"):  # started, and the first frame has not come
        driver.read(0.01)
    assert camera.starts == starts + 1
    camera.send(DEPTH, 9000.0)
    assert driver.read(0.01) is not None


def test_a_camera_that_falls_silent_is_lost(camera: Camera) -> None:
    clock = ManualClock()
    driver = RealSenseCamera(CONFIG, clock)
    for _ in range(49):  # the first frame may take its time
        clock.advance(0.1)
        assert driver.read(0.01) is None
    camera.send(DEPTH, 100.0)
    assert driver.read(0.01) is not None
    with pytest.raises(DeviceError, match="sends no frames"):
        for _ in range(12):
            clock.advance(0.1)
            driver.read(0.01)
    assert (camera.stops, camera.resets) == (1, 1)


def test_nobody_listening_is_not_silence(camera: Camera) -> None:
    clock = ManualClock()
    driver = RealSenseCamera(CONFIG, clock)
    clock.advance(60.0)  # the kernels were compiled
    assert driver.read(0.01) is None


def test_another_camera_is_refused(camera: Camera) -> None:
    clock = ManualClock()
    driver = RealSenseCamera(CONFIG, clock)
    camera.is_lost = True
    with pytest.raises(DeviceError):
        driver.read(0.01)
    camera.is_lost = False
    camera.lens.fx = 600.0
    for _ in range(2):
        clock.advance(3.0)
        with pytest.raises(DeviceError, match="another camera"):
            driver.read(0.01)


@pytest.mark.parametrize(
    ("fault", "words"),
    [("Couldn't resolve requests", "USB 2"), ("failed to set power state: Device or resource busy", "another program")],
)
def test_what_hinders_the_start_is_explained(camera: Camera, fault: str, words: str) -> None:
    camera.fault = fault
    with pytest.raises(DeviceError, match=words):
        RealSenseCamera(CONFIG, ManualClock())


def test_a_missing_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    with pytest.raises(DeviceError, match="pyrealsense2 is not installed"):
        RealSenseCamera(CONFIG, ManualClock())


def test_another_camera_than_the_one_named_is_told_at_once(camera: Camera) -> None:
    """librealsense itself waits 15 s for one that is not there."""
    with pytest.raises(DeviceError, match="is not found"):
        RealSenseCamera(DepthCameraConfig(serial="f0123"), ManualClock())
    assert camera.starts == 0
