"""`calibrate encoders`: which way they count, and how far a tick is. The operator pushes; no motor turns."""

from __future__ import annotations

import math

import numpy as np

from robot_app.calibrate.change import Change
from robot_app.calibrate.guide import CalibrationError, Guide, nothing
from robot_app.config import RobotConfig
from robot_app.drivers.base import EncoderCount, Encoders

_RUNS = 3
_FEWEST_TICKS = 40  # half a turn: below that a tick is more than 2 %
_WHEELS_DIFFER = 0.10  # as much as a curve or lost ticks make; two wheels of one batch differ by 1 %
_RUNS_DIFFER = 0.02
_TAPE_M = 0.003  # how well the robot is put to the two marks


def calibrate_encoders(encoders: Encoders, config: RobotConfig, guide: Guide) -> list[Change]:
    """`encoders`: as they are wired, none reversed. Raises `CalibrationError` when the runs do not agree."""
    guide.say(
        "Make two marks on the floor, on a straight line; 2 m or more apart is best. Lift nothing: the wheels\n"
        "have to roll. The motor stays off."
    )
    distance_m = guide.number("How far apart are the marks, in metres?", 0.5, 20.0)
    ticks = np.array([_run(encoders, guide, i + 1) for i in range(_RUNS)], np.float64)
    _check(ticks, config)
    e, o = config.devices.encoders, config.odometry
    left_counts_down, right_counts_down = (bool(np.median(wheel) < 0) for wheel in ticks.T)
    measured_m = np.abs(ticks).mean(axis=1) * math.tau * config.car.wheel_radius_m / o.ticks_per_turn
    scales = distance_m / measured_m
    if np.ptp(scales) > _RUNS_DIFFER * float(np.median(scales)):
        shown = ", ".join(f"{s:.3f}" for s in scales)
        raise CalibrationError(f"the {_RUNS} runs differ too much ({shown}); push straight, from mark to mark")
    spread = float(np.ptp(scales)) / 1.69 / math.sqrt(_RUNS)  # the range of three normal numbers is 1.69 deviations
    sigma = math.hypot(spread, _TAPE_M / distance_m / math.sqrt(_RUNS))
    left, right = np.abs(ticks).mean(axis=0)
    guide.say(f"Left {left:.0f} ticks, right {right:.0f}: they differ by {100 * (left / right - 1):+.1f} %.")
    certainty = "from which way it counted"
    return [
        Change("devices.encoders.left_reversed", e.left_reversed, left_counts_down, certainty),
        Change("devices.encoders.right_reversed", e.right_reversed, right_counts_down, certainty),
        Change("odometry.distance_scale", o.distance_scale, float(np.median(scales)), f"± {sigma:.4f}"),
    ]


def _run(encoders: Encoders, guide: Guide, number: int) -> tuple[int, int]:
    def follow() -> None:
        encoders.read(0.0)  # the kernel keeps a bounded number of edges

    guide.until_enter(f"Run {number} of {_RUNS}: put the rear axle at the first mark", nothing)
    before = encoders.read(0.0)
    guide.until_enter("Push it FORWARD, straight, until the rear axle is at the second mark", follow)
    after = encoders.read(0.0)
    if not (isinstance(before, EncoderCount) and isinstance(after, EncoderCount)):
        raise CalibrationError("the encoders say nothing")
    return after.left - before.left, after.right - before.right


def _check(ticks: np.ndarray[tuple[int, int], np.dtype[np.float64]], config: RobotConfig) -> None:
    e = config.devices.encoders
    wires = {"left": (e.left_a, e.left_b), "right": (e.right_a, e.right_b)}
    for (name, (a, b)), wheel in zip(wires.items(), ticks.T, strict=True):
        if np.abs(wheel).min() < _FEWEST_TICKS:
            raise CalibrationError(
                f"the {name} encoder counted {wheel[np.argmin(np.abs(wheel))]:+.0f} ticks in a run: was the robot "
                f"pushed all the way? If so, look at its supply and at the wires of GPIO {a} and {b}"
            )
        if np.ptp(np.sign(wheel)):
            raise CalibrationError(f"the {name} encoder counted up in one run and down in another; push forward only")
    left, right = np.abs(ticks).T
    if np.abs(left / right - 1).max() > _WHEELS_DIFFER:
        raise CalibrationError(
            f"left counted {left[0]:.0f} ticks and right {right[0]:.0f}: the robot went in a curve, or an encoder "
            "loses ticks; push straight and try again"
        )
