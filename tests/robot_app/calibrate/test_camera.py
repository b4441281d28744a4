"""Floor and wall as a camera sees them that sits otherwise than its file says."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from robot_app.calibrate.camera import calibrate_camera
from robot_app.calibrate.guide import CalibrationError
from robot_app.config import RobotConfig
from robot_app.drivers.base import DepthImage, RawScan
from shared.geometry.camera import CameraMount, Intrinsics
from shared.geometry.se2 import Pose2
from shared.messages import ScanGeometry
from shared.runtime.clock import ManualClock
from tests.robot_app.calibrate.scripted import Operator, values

LENS = Intrinsics.from_field_of_view(320, 240, math.radians(70), math.radians(50))
UNIT_M = 0.00025
DEGREE = math.pi / 180


class Room:
    """Level floor, and a wall once it is there: at `wall_m` along a normal turned by `wall_rad` to the left."""

    def __init__(self, mount: CameraMount) -> None:
        self.mount = mount
        self.wall_m, self.wall_rad = 60.0, 0.0
        self.bumps_m = 0.0
        self._random = np.random.default_rng(2)

    def depth_m(self) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
        columns, rows = LENS.ray_slopes()
        rays = np.stack(np.broadcast_arrays(columns[None, :], rows[:, None], 1.0), axis=-1).astype(np.float64)
        matrix = self.mount.robot_from_optical()
        rays = rays @ matrix[:3, :3].T
        origin = matrix[:3, 3]
        with np.errstate(divide="ignore"):
            floor_m = np.where(rays[..., 2] < 0, -origin[2] / rays[..., 2], np.inf)
        normal = np.array([math.cos(self.wall_rad), math.sin(self.wall_rad), 0.0])
        wall_m = (self.wall_m - origin @ normal) / (rays @ normal)
        depth = np.minimum(floor_m, np.where(wall_m > 0, wall_m, np.inf))
        noise = self._random.standard_normal(depth.shape)
        depth = depth * (1 + 0.003 * noise) + self.bumps_m * self._random.standard_normal(depth.shape)
        return np.where((depth > 0.5) & (depth < 9.0), depth, 0.0)


class Camera:
    intrinsics = LENS

    def __init__(self, room: Room) -> None:
        self._room = room

    def read(self, timeout_s: float) -> DepthImage:
        return DepthImage(0.0, np.rint(self._room.depth_m() / UNIT_M).clip(0, 65_535).astype(np.uint16), UNIT_M)

    def close(self) -> None:
        """Nothing to let go."""


class Scanner:
    geometry = ScanGeometry(-2.09, math.tau / 1024, 2.7e-5, 0.06, 4.0, Pose2(0.25, 0.0, 0.0))

    def __init__(self, room: Room) -> None:
        self._room = room
        self._random = np.random.default_rng(3)

    def read(self, timeout_s: float) -> RawScan:
        angles = self.geometry.angles_rad(682)
        towards = np.cos(angles - self._room.wall_rad)
        ranges = (self._room.wall_m - 0.25 * math.cos(self._room.wall_rad)) / np.where(towards > 0, towards, np.nan)
        ranges += 0.01 * self._random.standard_normal(682)
        ranges[ranges > 4.0] = np.nan
        return RawScan(0.0, ranges.astype(np.float32))

    def close(self) -> None:
        """Nothing to let go."""


def before_a_wall(room: Room, wall_m: float, wall_rad: float) -> Operator:
    def put(_: Callable[[], None]) -> None:
        room.wall_m, room.wall_rad = wall_m, wall_rad

    return Operator(lambda _: None, put)


def test_pitch_roll_height_and_direction_are_found(config: RobotConfig) -> None:
    room = Room(CameraMount(0.28, 0.182, 3.0 * DEGREE, 1.5 * DEGREE, -2.0 * DEGREE))
    changes = calibrate_camera(Camera(room), Scanner(room), config, before_a_wall(room, 1.3, 0.1), ManualClock())
    found = values(changes)
    assert found["pitch_down_rad"] == pytest.approx(3.0 * DEGREE, abs=0.05 * DEGREE)
    assert found["roll_right_rad"] == pytest.approx(1.5 * DEGREE, abs=0.05 * DEGREE)
    assert found["z_m"] == pytest.approx(0.182, abs=0.001)
    assert found["yaw_left_rad"] == pytest.approx(-2.0 * DEGREE, abs=0.3 * DEGREE)
    assert [change.certainty for change in changes[:3]] == ["± 0.10°", "± 0.10°", "± 2.0 mm"]


def test_a_camera_that_is_tilted_by_ten_degrees_is_still_found(config: RobotConfig) -> None:
    room = Room(CameraMount(0.28, 0.15, 10.0 * DEGREE, -4.0 * DEGREE))
    changes = calibrate_camera(Camera(room), Scanner(room), config, Operator(agrees=False), ManualClock())
    found = values(changes)
    assert found["pitch_down_rad"] == pytest.approx(10.0 * DEGREE, abs=0.1 * DEGREE)
    assert found["roll_right_rad"] == pytest.approx(-4.0 * DEGREE, abs=0.1 * DEGREE)
    assert "yaw_left_rad" not in found


def test_a_camera_that_sits_elsewhere_than_thought_is_told(config: RobotConfig) -> None:
    room = Room(CameraMount(0.20, 0.17, 0.0))
    operator = before_a_wall(room, 1.2, 0.0)
    calibrate_camera(Camera(room), Scanner(room), config, operator, ManualClock())
    assert "measure camera.x_m with a ruler" in operator.heard[-1]


@pytest.mark.parametrize(
    ("mount", "wall_m", "bumps_m", "words"),
    [
        (CameraMount(0.28, 0.17, -30 * DEGREE), 60.0, 0.0, "does not see the floor"),
        (CameraMount(0.28, 0.17, 0.0), 0.85, 0.0, "does not see the floor|of floor are seen|is none"),
        (CameraMount(0.28, 0.17, 0.0), 60.0, 0.4, "not flat"),
    ],
)
def test_what_is_no_floor_is_refused(
    config: RobotConfig, mount: CameraMount, wall_m: float, bumps_m: float, words: str
) -> None:
    room = Room(mount)
    room.wall_m, room.bumps_m = wall_m, bumps_m
    with pytest.raises(CalibrationError, match=words):
        calibrate_camera(Camera(room), Scanner(room), config, Operator(agrees=False), ManualClock())
