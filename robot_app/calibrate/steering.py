"""`calibrate steering`: the servo's trim and gain, by driving arcs and asking the gyro how much they curve."""

from __future__ import annotations

import math

import numpy as np

from robot_app.calibrate.change import Change
from robot_app.calibrate.driven_car import DrivenCar, Run
from robot_app.calibrate.estimate import Estimate, line
from robot_app.calibrate.guide import CalibrationError, Guide
from robot_app.config import RobotConfig

_WAY_M = 1.0
_STEERINGS_RAD = (0.0, 0.15, -0.15)  # so little that the arcs stay within a strip of 1.5 m
_SETTLED = 0.15  # share of a run after which speed and tyres are steady
_MOST_TRIM_RAD = 0.25
_LEAST_GAIN, _MOST_GAIN = 0.4, 2.5
_ROUNDS = 2
_SCALES = 0.015  # by how much gyro and encoders may be off together: it goes into the gain
_STRAIGHT_M = 2.0  # over which the drift is told


def calibrate_steering(car: DrivenCar, config: RobotConfig, guide: Guide) -> list[Change]:
    """Forward and back along each arc, so that backlash and a sloping floor cancel. Raises `CalibrationError`."""
    arcs = len(_STEERINGS_RAD) + _ROUNDS
    guide.say(
        f"The car will drive {_WAY_M:g} m forward and back again, {arcs} times, at 0.2 m/s, straight and in slight\n"
        "curves. It needs a level floor, 2.5 m ahead and 0.8 m to each side, and nobody on it. It looks ahead,\n"
        "not back. Ctrl-C stops it at any time."
    )
    if not guide.agree("THE WHEELS WILL TURN. Is the floor free?"):
        raise CalibrationError("nothing was driven and nothing was changed")
    steerings: list[float] = []
    angles: list[float] = []
    for steering_rad in _STEERINGS_RAD:
        _drive(car, config, steering_rad, steerings, angles)
        guide.say(f"  steering {steering_rad:+.2f} rad: the wheels stood at {np.mean(angles[-2:]):+.3f} rad")
    straight, gain = _solve(steerings, angles)
    for _ in range(_ROUNDS):  # closed loop: drive what should be straight, and learn from what is left
        _drive(car, config, straight.value, steerings, angles)
        straight, gain = _solve(steerings, angles)
    drift_m = _STRAIGHT_M**2 / 2 * math.tan(abs(np.mean(angles[-2:]))) / config.car.wheelbase_m
    guide.say(
        f"Straight is at {straight.value:+.4f} rad; the last runs leave the line by {drift_m * 100:.1f} cm in 2 m."
    )
    d = config.devices.drive
    return [
        Change(
            "devices.drive.servo_trim_us",
            d.servo_trim_us,
            d.servo_trim_us + d.servo_us_per_rad * straight.value,
            f"± {abs(d.servo_us_per_rad) * straight.sigma:.1f} us",
        ),
        Change(
            "devices.drive.servo_us_per_rad",
            d.servo_us_per_rad,
            d.servo_us_per_rad / gain.value,
            f"± {abs(d.servo_us_per_rad / gain.value) * math.hypot(gain.sigma / gain.value, _SCALES):.0f}",
        ),
    ]


def _drive(
    car: DrivenCar, config: RobotConfig, steering_rad: float, steerings: list[float], angles: list[float]
) -> None:
    for way_m in (_WAY_M, -_WAY_M):
        car.stand(steering_rad)
        curvature_per_m = _curvature_per_m(car.run(steering_rad, way_m))
        steerings.append(steering_rad)
        angles.append(math.atan(curvature_per_m * config.car.wheelbase_m))


def _curvature_per_m(run: Run) -> float:
    settled = np.abs(run.ways_m) > _SETTLED * abs(run.ways_m[-1])
    return float(line(run.ways_m[settled], run.headings_rad[settled])[0][1])


def _solve(steerings: list[float], angles: list[float]) -> tuple[Estimate, Estimate]:
    """Straight, and how far the wheels turn for a radian that is asked for: angle = gain (steering - straight)."""
    (intercept, gain), covariance = line(steerings, angles)
    if not _LEAST_GAIN <= abs(gain) <= _MOST_GAIN:
        raise CalibrationError(
            f"the wheels turn {gain:.2f} times as far as asked: look at devices.drive.servo_us_per_rad and the linkage"
        )
    straight = -intercept / gain
    if abs(straight) > _MOST_TRIM_RAD:
        raise CalibrationError(f"straight is {straight:+.2f} rad off: put the servo's horn on its splines anew")
    slopes = np.array([-1 / gain, intercept / gain**2])
    sigma = math.sqrt(max(float(slopes @ covariance @ slopes), 0.0))
    return Estimate(straight, sigma), Estimate(float(gain), math.sqrt(covariance[1, 1]))
