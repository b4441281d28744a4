"""The car, driven by a calibration for a metre or so: along a given steering, at a steady speed, and watched."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_app.calibrate.estimate import Estimate, steady
from robot_app.calibrate.guide import CalibrationError
from robot_app.calibrate.sampling import pause
from robot_app.config import RobotConfig
from robot_app.control.speed import SpeedController
from robot_app.drivers.base import Drive, DriveSetting, EncoderCount, Encoders, Imu, Scanner
from shared.runtime.clock import Clock

_TICK_S = 0.01
_SPEED_MPS = 0.2
_SPEED_WINDOW_S = 0.1
_SILENCE_S = 0.25  # of encoders, gyro or scanner, after which the car stops
_STALL_S = 1.0  # without a tick under current
_WRONG_WAY_M = 0.03
_TOO_FAST = 2.5  # times the speed asked for
_TILT_COS = 0.8  # 37°: the car is being lifted, or falls
_GAP_M = 0.25  # kept free in front of the bumper
_BESIDE_M = 0.05
_STANDS_S = 1.5
_STEADY_RADPS = 0.02
_GRAVITY_MPS2 = 9.80665


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """`ways_m` (N,) from the start, negative backwards; `headings_rad` (N,) by the gyro, from 0."""

    ways_m: NDArray[np.float64]
    headings_rad: NDArray[np.float64]


class DrivenCar:
    """Every method leaves the motor cut, whatever happens. Raises `CalibrationError` or `DeviceError`."""

    def __init__(
        self, drive: Drive, encoders: Encoders, imu: Imu, scanner: Scanner, config: RobotConfig, clock: Clock
    ) -> None:
        self._drive, self._encoders, self._imu, self._scanner = drive, encoders, imu, scanner
        self._clock = clock
        self._car = config.car
        self._speed = SpeedController(config.control.speed)
        turn_m = math.tau * config.car.wheel_radius_m * config.odometry.distance_scale
        self._metres_per_tick = turn_m / config.odometry.ticks_per_turn
        self._bias_radps = 0.0
        self._count = EncoderCount(-math.inf, 0, 0)

    def stand(self, steering_rad: float) -> Estimate:
        """Turn the wheels to `steering_rad`, wait, and take the gyro's bias."""
        try:
            self._drive.set(DriveSetting(0.0, steering_rad))
            pause(self._clock, 0.6)
            rates, before = [], self._newest_count()
            due_s = self._clock.now_s() + _STANDS_S
            while self._clock.now_s() < due_s:
                sample = self._imu.read(_TICK_S)
                if sample is not None:
                    rates.append(sample.gyro_radps[2])
                pause(self._clock, _TICK_S)
            self._scanner.read(0.0)
        finally:
            self._drive.stop()
        if len(rates) < 0.3 * _STANDS_S / _TICK_S:
            raise CalibrationError("the gyro sends too little; look at it with: robot-app check")
        after = self._newest_count()
        if (after.left, after.right) != (before.left, before.right) or np.std(rates) > _STEADY_RADPS:
            raise CalibrationError("the car moved while it should stand; put it on firm ground and try again")
        bias = steady(rates)
        self._bias_radps = bias.value
        return bias

    def run(self, steering_rad: float, way_m: float) -> Run:
        """Drive `way_m`, negative backwards, and stop."""
        try:
            return self._run(steering_rad, way_m)
        finally:
            self._drive.stop()

    def _run(self, steering_rad: float, way_m: float) -> Run:
        self._speed.reset()
        start = self._newest_count()
        began_s = last_gyro_s = moved_s = self._clock.now_s()
        watch = _Watch(began_s)
        heading_rad, done_m = 0.0, 0.0
        ways, headings = [0.0], [0.0]
        recent: deque[tuple[float, float]] = deque([(began_s, 0.0)], maxlen=64)
        longest_s = 3.0 + 3 * abs(way_m) / _SPEED_MPS
        target_mps = math.copysign(_SPEED_MPS, way_m)
        while abs(done_m) < abs(way_m):
            now_s = self._clock.now_s()
            if now_s - began_s > longest_s:
                raise CalibrationError(f"{abs(done_m):.2f} m in {longest_s:.0f} s only; is the battery charged?")
            before_m, done_m = done_m, self._way_m(start, watch)
            moved_s = now_s if done_m != before_m else moved_s
            imu = self._imu.read(0.0)
            if imu is not None:
                watch.gyro_s = now_s
                heading_rad += (imu.gyro_radps[2] - self._bias_radps) * (imu.stamp_s - last_gyro_s) * (len(ways) > 1)
                last_gyro_s = imu.stamp_s
                self._check_level(imu.acceleration_mps2)
            self._check_scan(watch, now_s, is_forward=way_m > 0)
            speed_mps = _speed_mps(recent, now_s, done_m)
            self._check(watch, now_s, now_s - moved_s, done_m, speed_mps, target_mps)
            ways.append(done_m)
            headings.append(heading_rad)
            self._drive.set(DriveSetting(self._speed.step(now_s, target_mps, speed_mps), steering_rad))
            pause(self._clock, _TICK_S)
        return Run(np.array(ways), np.array(headings))

    def _newest_count(self) -> EncoderCount:
        count = self._encoders.read(0.0)
        if isinstance(count, EncoderCount):
            self._count = count
        return self._count

    def _way_m(self, start: EncoderCount, watch: _Watch) -> float:
        count = self._newest_count()
        watch.encoders_s = count.stamp_s
        return (count.left - start.left + count.right - start.right) / 2 * self._metres_per_tick

    def _check_scan(self, watch: _Watch, now_s: float, is_forward: bool) -> None:
        scan = self._scanner.read(0.0)
        if scan is None:
            return
        watch.scanner_s = now_s
        if not is_forward:  # nobody looks back there; the car goes the way it came
            return
        geometry = self._scanner.geometry
        angles = geometry.angles_rad(len(scan.ranges_m))
        points_m = geometry.robot_from_scanner.apply(
            np.column_stack([scan.ranges_m * np.cos(angles), scan.ranges_m * np.sin(angles)])
        )
        ahead_m = points_m[:, 0] - self._car.front_m
        near = (ahead_m > 0) & (ahead_m < _GAP_M) & (np.abs(points_m[:, 1]) < self._car.width_m / 2 + _BESIDE_M)
        if np.any(near):
            raise CalibrationError(f"something stands {float(ahead_m[near].min()):.2f} m ahead; clear the floor")

    @staticmethod
    def _check_level(acceleration_mps2: tuple[float, float, float]) -> None:
        size = math.hypot(*acceleration_mps2)
        if size > 0.5 * _GRAVITY_MPS2 and acceleration_mps2[2] < _TILT_COS * size:
            raise CalibrationError("the car is not level, or the IMU's axes are wrong: robot-app calibrate imu")

    @staticmethod
    def _check(watch: _Watch, now_s: float, still_s: float, done_m: float, speed_mps: float, target_mps: float) -> None:
        silent = watch.silent(now_s)
        if silent:
            raise CalibrationError(f"the {silent} fell silent while driving; look at it with: robot-app check")
        if still_s > _STALL_S:
            raise CalibrationError("the motor gets current and the encoders count nothing: a wheel or a wire is stuck")
        if done_m * target_mps < 0 and abs(done_m) > _WRONG_WAY_M:
            raise CalibrationError("the car goes the wrong way: robot-app calibrate encoders, then motor")
        if abs(speed_mps) > _TOO_FAST * abs(target_mps):
            raise CalibrationError(f"{abs(speed_mps):.2f} m/s is too fast; is odometry.distance_scale right?")


@dataclass(slots=True)
class _Watch:
    """When each device spoke last."""

    began_s: float
    encoders_s: float = 0.0
    gyro_s: float = 0.0
    scanner_s: float = 0.0

    def silent(self, now_s: float) -> str:
        for name, spoke_s in (("encoders", self.encoders_s), ("gyro", self.gyro_s), ("scanner", self.scanner_s)):
            if now_s - max(spoke_s, self.began_s) > _SILENCE_S:
                return name
        return ""


def _speed_mps(recent: deque[tuple[float, float]], now_s: float, done_m: float) -> float:
    recent.append((now_s, done_m))
    while len(recent) > 2 and now_s - recent[1][0] >= _SPEED_WINDOW_S:
        recent.popleft()
    then_s, then_m = recent[0]
    return (done_m - then_m) / (now_s - then_s) if now_s > then_s else 0.0
