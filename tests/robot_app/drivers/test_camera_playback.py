"""The camera's driver against the real librealsense, which plays what its software device recorded."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from robot_app.drivers.config import DepthCameraConfig
from robot_app.drivers.l515 import RealSenseCamera
from shared.runtime.clock import MonotonicClock

LIBRARY = Path(__file__).with_name("camera_playback")
FRAMES = 20

RECORD = f"""
import sys, numpy, pyrealsense2 as rs
device = rs.software_device()
device.register_info(rs.camera_info.name, "Intel RealSense L515")
sensor = device.add_sensor("L500 Depth Sensor")
sensor.add_read_only_option(rs.option.depth_units, 0.00025)
lens = rs.intrinsics()
lens.width, lens.height, lens.fx, lens.fy, lens.ppx, lens.ppy = 640, 480, 457.0, 461.0, 319.5, 239.5
lens.model, lens.coeffs = rs.distortion.none, [0.0] * 5
video = rs.video_stream()
video.type, video.fmt, video.intrinsics = rs.stream.depth, rs.format.z16, lens
video.index, video.uid, video.width, video.height, video.fps, video.bpp = 0, 1, 640, 480, 30, 2
profile = sensor.add_video_stream(video).as_video_stream_profile()
recorder = rs.recorder(sys.argv[1], device)
recorded, queue = recorder.query_sensors()[0], rs.frame_queue({FRAMES})
recorded.open(recorded.get_stream_profiles()[0])
recorded.start(queue)
for number in range(1, {FRAMES} + 1):
    frame = rs.software_video_frame()
    frame.bpp, frame.stride, frame.profile = 2, 1280, profile
    frame.timestamp, frame.domain, frame.frame_number = 33.3 * number, rs.timestamp_domain.hardware_clock, number
    frame.pixels = numpy.full((480, 640), number, numpy.uint16)
    sensor.on_video_frame(frame)
    queue.wait_for_frame(1000)
recorded.stop()
recorded.close()
"""

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("pyrealsense2") is None, reason="pyrealsense2 is not installed: it is the robot's"
)


def test_frames_of_the_real_library_pass_through_the_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = tmp_path / "depth.bag"
    subprocess.run([sys.executable, "-c", RECORD, str(recording)], check=True, timeout=60)
    monkeypatch.setenv("RECORDING", str(recording))
    monkeypatch.syspath_prepend(str(LIBRARY))
    monkeypatch.setenv("PYTHONPATH", ":".join(sys.path))
    driver = RealSenseCamera(DepthCameraConfig(interpreter=sys.executable), MonotonicClock())
    try:
        images = [image for image in (driver.read(0.2) for _ in range(FRAMES)) if image is not None]
        assert "L515" in driver.model
        assert (driver.intrinsics.fx, driver.intrinsics.cx) == (457.0, 320.0)
    finally:
        driver.close()
    assert len(images) >= FRAMES // 2
    for image in images:
        assert image.unit_m == pytest.approx(0.00025)
        np.testing.assert_array_equal(image.depth, image.depth[0, 0])
    numbers = [int(image.depth[0, 0]) for image in images]
    assert all(1 <= number <= FRAMES for number in numbers)
    assert numbers[:5] == sorted(set(numbers[:5]))
