"""As much of pyrealsense2 as the camera process uses; the environment says what the camera does.

CAMERA: `frames`, `silent`, `absent`, `lost` after one frame, `hangs` after one frame, `hangs_at_start`, `late` by 0.3 s
"""

import array
import os
import threading
from types import SimpleNamespace

CAMERA = os.environ["CAMERA"]
NEVER = threading.Event()
stream = SimpleNamespace(depth="depth")
format = SimpleNamespace(z16="z16")  # noqa: A001 - the library's name
camera_info = SimpleNamespace(name="name", serial_number="serial number")


def context():
    return SimpleNamespace(query_devices=list)


def pipeline_wrapper(wrapped):
    return wrapped


class config:  # noqa: N801 - the library's name
    def enable_device(self, serial):
        self.serial = serial

    def enable_stream(self, *wanted):
        self.width, self.height = wanted[1:3]

    def can_resolve(self, _pipeline):
        return CAMERA != "absent"


class pipeline:  # noqa: N801
    def __init__(self):
        self.fetched = 0

    def start(self, request):
        if CAMERA == "absent":
            NEVER.wait(15.0)  # as the library does
            raise RuntimeError("No device connected")
        if CAMERA == "hangs_at_start":
            NEVER.wait()
        self.size = request.width * request.height
        lens = SimpleNamespace(width=request.width, height=request.height, fx=45.0, fy=46.0, ppx=31.5, ppy=23.5)
        sensor = SimpleNamespace(get_depth_scale=lambda: 0.00025)
        device = SimpleNamespace(first_depth_sensor=lambda: sensor, get_info=lambda _: "L515\n\x1b[2J")
        device.hardware_reset = lambda: os.write(2, b"camera is reset")
        video = SimpleNamespace(get_intrinsics=lambda: lens)
        profile = SimpleNamespace(as_video_stream_profile=lambda: video)
        return SimpleNamespace(get_device=lambda: device, get_stream=lambda _: profile)

    def try_wait_for_frames(self, timeout_ms):
        """The next frame is there when it is asked for; its pixels are its number."""
        if CAMERA == "silent":
            NEVER.wait(timeout_ms / 1000)
            return False, None
        if CAMERA == "lost" and self.fetched:
            raise RuntimeError("Device disconnected")
        if CAMERA == "hangs" and self.fetched:
            NEVER.wait()
        if CAMERA == "late":
            NEVER.wait(0.3)
        self.fetched += 1
        number, data = self.fetched, memoryview(array.array("H", [self.fetched]) * self.size)
        frame = SimpleNamespace(
            get_frame_number=lambda: number, get_timestamp=lambda: 1000.0 + 33.0 * number, get_data=lambda: data
        )
        return True, SimpleNamespace(get_depth_frame=lambda: frame)

    def stop(self):
        pass
