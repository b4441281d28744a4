"""A light, deterministic car among line segments for the tests of the controllers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from robot_app.control.motion import Motion
from robot_app.control.speed import SpeedConfig, SpeedController
from shared.geometry.ackermann import CarGeometry
from shared.geometry.rays import cast_rays, polygon_clearance_m
from shared.geometry.se2 import Pose2
from shared.messages import ScanGeometry

CAR = CarGeometry(0.26, 0.17, 0.04, 0.5, 0.305, 0.045, 0.20)
SCAN = ScanGeometry(
    first_angle_rad=math.radians(-119.5),
    step_rad=math.radians(239.77) / 681,
    beam_interval_s=0.028 / 1024,
    range_min_m=0.06,
    range_max_m=4.0,
    robot_from_scanner=Pose2(0.25, 0.0, 0.0),
)
BEAMS = 682


def rectangle(x: float, y: float, length: float, width: float, theta: float = 0.0) -> NDArray[np.float64]:
    """(4, 4) segments of a box with its middle at (x, y)."""
    half = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (length / 2, width / 2)
    corners = Pose2(x, y, theta).apply(half)
    return np.hstack((corners, np.roll(corners, -1, axis=0)))


@dataclass
class SimulatedCar:
    """A bicycle with a motor lag, a servo lag, a noisy scanner and a slightly wrong odometry."""

    segments_m: NDArray[np.float64]
    pose: Pose2
    generator: np.random.Generator
    noise_m: float = 0.01
    now_s: float = 0.0
    speed_mps: float = 0.0
    steering_rad: float = 0.0
    odom: Pose2 = field(default_factory=Pose2)
    distance_m: float = 0.0
    clearance_m: float = math.inf
    clearance_at: Pose2 = field(default_factory=Pose2)

    def __post_init__(self) -> None:
        self._speed = SpeedController(SpeedConfig())
        self._scale = 1.0 + 0.004 * self.generator.standard_normal()
        self._gyro_bias = 0.002 * self.generator.standard_normal()

    def scan(self) -> NDArray[np.float32]:
        scanner = self.pose @ SCAN.robot_from_scanner
        ranges = np.empty(BEAMS)
        angles = SCAN.angles_rad(BEAMS) + scanner.theta_rad
        cast_rays(scanner.x_m, scanner.y_m, angles, self.segments_m, SCAN.range_max_m, ranges)
        ranges += self.noise_m * self.generator.standard_normal(BEAMS)
        ranges[(self.generator.random(BEAMS) < 0.01) | (ranges < SCAN.range_min_m)] = np.nan
        return ranges.astype(np.float32)

    def drive(self, motion: Motion, duration_s: float, step_s: float = 0.01) -> None:
        for _ in range(round(duration_s / step_s)):
            self._tick(motion, step_s)
        self._measure_clearance()

    def _tick(self, motion: Motion, step_s: float) -> None:
        duty = self._speed.step(self.now_s + step_s, motion.speed_mps, self._measured_mps())
        self.push(duty, motion.steering_rad, step_s)

    def push(self, duty: float, steering_rad: float, step_s: float) -> None:
        self.now_s += step_s
        self.speed_mps += step_s / 0.12 * (0.68 * duty - math.copysign(0.01, self.speed_mps) - self.speed_mps)
        if duty == 0.0 and abs(self.speed_mps) < 0.02:
            self.speed_mps = 0.0
        wanted = max(-CAR.max_steering_rad, min(CAR.max_steering_rad, steering_rad))
        rate = max(-5.0, min(5.0, (wanted - self.steering_rad) / 0.06))
        self.steering_rad += rate * step_s
        way = self.speed_mps * step_s
        turn = way * CAR.curvature_per_m(self.steering_rad)
        self.pose = self.pose @ Pose2(way * math.cos(turn / 2), way * math.sin(turn / 2), turn)
        way, turn = way * self._scale, turn + self._gyro_bias * step_s
        self.odom = self.odom @ Pose2(way * math.cos(turn / 2), way * math.sin(turn / 2), turn)
        self.distance_m += abs(way)

    def _measured_mps(self) -> float:
        return self.speed_mps + 0.004 * float(self.generator.standard_normal())

    def _measure_clearance(self) -> None:
        corners = self.pose.apply(np.array(CAR.footprint_m()))
        clearance = polygon_clearance_m(corners, self.segments_m)
        if clearance < self.clearance_m:
            self.clearance_m, self.clearance_at = clearance, self.pose


def lab(seed: int) -> NDArray[np.float64]:
    """A room of 3.95 x 4.2 m with clutter along the walls and an island."""
    generator = np.random.default_rng(seed)
    walls = rectangle(1.975, 2.1, 3.95, 4.2)
    boxes = [
        rectangle(0.25, 1.2, 0.5, 0.6),
        rectangle(0.2, 2.9, 0.4, 0.5, 0.2),
        rectangle(1.5, 4.0, 0.7, 0.4),
        rectangle(3.6, 3.8, 0.6, 0.6, 0.5),
        rectangle(3.7, 1.8, 0.4, 0.8),
        rectangle(2.4, 0.2, 0.5, 0.4, 0.1),
        rectangle(2.0, 2.1, 0.5, 0.4, 0.4),
    ]
    for _ in range(3):
        x, y = generator.uniform(0.2, 3.7), generator.uniform(0.2, 4.0)
        side = int(generator.integers(4))
        spot = [(0.15, y), (3.8, y), (x, 0.15), (x, 4.05)][side]
        boxes.append(rectangle(*spot, *generator.uniform(0.1, 0.35, 2), generator.uniform(0, math.pi)))
    return np.vstack((walls, *boxes))


@pytest.fixture(name="lab")
def _lab() -> Callable[[int], NDArray[np.float64]]:
    return lab


@pytest.fixture(name="rectangle")
def _rectangle() -> Callable[..., NDArray[np.float64]]:
    return rectangle


@pytest.fixture(name="simulated_car")
def _simulated_car() -> type[SimulatedCar]:
    return SimulatedCar


@pytest.fixture(name="car")
def _car() -> CarGeometry:
    return CAR


@pytest.fixture(name="scan_geometry")
def _scan_geometry() -> ScanGeometry:
    return SCAN
