"""`calibrate imu`: which axis of the chip points where, and what it says at rest. The operator lifts and turns."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from robot_app.calibrate.change import Change
from robot_app.calibrate.estimate import steady, typical
from robot_app.calibrate.guide import CalibrationError, Guide
from robot_app.calibrate.sampling import collect
from robot_app.config import AnyRobotConfig
from robot_app.drivers.base import Imu, ImuSample
from robot_app.drivers.config import Axis
from shared.runtime.clock import Clock

_GRAVITY_MPS2 = 9.80665
_EVERY_S = 0.01
_REST_SAMPLES, _POSE_SAMPLES = 600, 60
_STILL_RADPS = 0.03  # spread of the gyro while nobody touches the robot
_STILL_MPS2 = 0.5
_LEAST_LIFT_MPS2 = _GRAVITY_MPS2 * math.sin(math.radians(20))
_LEAST_TURN_RAD = math.radians(20)
_CLEAR = 2.0  # the axis meant has so many times more than the next
_MOST_GYRO_BIAS_RADPS = math.radians(30)  # zero-rate level of the data sheet
_MOST_ACCELERATION_BIAS_MPS2 = 2.0  # 90 mg of the data sheet, a chip glued on a little crooked, a floor not quite level
_LONGEST_GAP_S = 0.1

Vector = NDArray[np.float64]


@dataclass(slots=True)
class _Turning:
    """Adds up the gyro while the operator moves the robot."""

    imu: Imu
    bias_radps: Vector
    turned_rad: Vector
    last: ImuSample | None = None

    def step(self) -> None:
        sample = self.imu.read(0.0)
        if sample is None:
            return
        if self.last is not None:
            step_s = min(max(sample.stamp_s - self.last.stamp_s, 0.0), _LONGEST_GAP_S)
            self.turned_rad = self.turned_rad + (np.array(sample.gyro_radps) - self.bias_radps) * step_s
        self.last = sample


def calibrate_imu(chip: Imu, config: AnyRobotConfig, guide: Guide, clock: Clock) -> list[Change]:
    """`chip`: the IMU with its own axes, x, y, z, and no bias taken off. Raises `CalibrationError`."""
    guide.say("Put the robot on level floor. Nothing drives; you will lift it by hand.")
    guide.until_enter("Take your hands off it", lambda: None)
    guide.say("Six seconds at rest ...")
    rest = _held(chip, clock, _REST_SAMPLES)
    gyro, level = _columns(rest, "gyro_radps"), _columns(rest, "acceleration_mps2")
    bias = typical(gyro)
    nose, pitched = _moved(chip, bias, guide, clock, "Lift the NOSE by 30° or more, hold it")
    _moved(chip, bias, guide, clock, "Put it down level")
    left, rolled = _moved(chip, bias, guide, clock, "Lift the LEFT side by 30° or more, hold it")
    _moved(chip, bias, guide, clock, "Put it down level")
    _, yawed = _moved(chip, bias, guide, clock, "On the floor, turn it a quarter turn to the LEFT")
    up_mps2 = typical(level)
    forward_mps2, left_mps2 = (pose - up_mps2 for pose in (nose, left))
    limit = _LEAST_LIFT_MPS2
    acceleration_axes = _axes((forward_mps2, left_mps2, up_mps2), limit, "acceleration")
    # The nose goes up by a turn to the right about the axis that points left; the left side by one about that ahead.
    gyro_axes = _axes((rolled, -pitched, yawed), _LEAST_TURN_RAD, "turning")
    return _changes(config, acceleration_axes, gyro_axes, gyro, level)


def _changes(
    config: AnyRobotConfig,
    acceleration_axes: tuple[Axis, Axis, Axis],
    gyro_axes: tuple[Axis, Axis, Axis],
    gyro: Vector,
    level: Vector,
) -> list[Change]:
    """`gyro` and `level` (N, 3): at rest on level floor, chip axes."""
    i = config.devices.imu
    rates = [steady(column) for column in _mapped(gyro, gyro_axes).T]
    rests = [steady(column) for column in _mapped(level, acceleration_axes).T]
    gyro_bias = tuple(rate.value for rate in rates)
    acceleration_bias = (rests[0].value, rests[1].value, rests[2].value - _GRAVITY_MPS2)
    if max(map(abs, gyro_bias)) > _MOST_GYRO_BIAS_RADPS:
        raise CalibrationError(
            f"the gyro turns by {math.degrees(max(map(abs, gyro_bias))):.0f} °/s at rest: it is broken"
        )
    if max(map(abs, acceleration_bias)) > _MOST_ACCELERATION_BIAS_MPS2:
        raise CalibrationError("gravity is not where it should be: is the floor level, is the chip mounted straight?")
    gyro_sigma, rest_sigma = (max(e.sigma for e in estimates) for estimates in (rates, rests))
    return [
        Change("devices.imu.gyro_axes", i.gyro_axes, gyro_axes, "from the turns"),
        Change("devices.imu.acceleration_axes", i.acceleration_axes, acceleration_axes, "from gravity"),
        Change("devices.imu.gyro_bias_radps", i.gyro_bias_radps, gyro_bias, f"± {gyro_sigma:.5f} rad/s"),
        Change(
            "devices.imu.acceleration_bias_mps2",
            i.acceleration_bias_mps2,
            acceleration_bias,
            f"± {rest_sigma:.3f} m/s² and the floor's slope",
        ),
    ]


def _moved(chip: Imu, bias_radps: Vector, guide: Guide, clock: Clock, text: str) -> tuple[Vector, Vector]:
    """Acceleration in the new pose, and the turn to it; both of the chip's axes."""
    turning = _Turning(chip, bias_radps, np.zeros(3))
    guide.until_enter(text, turning.step)
    return typical(_columns(_held(chip, clock, _POSE_SAMPLES), "acceleration_mps2")), turning.turned_rad


def _held(chip: Imu, clock: Clock, count: int) -> list[ImuSample]:
    samples = collect(clock, count, _EVERY_S, lambda: chip.read(0.02), "IMU")
    gyro, acceleration = _columns(samples, "gyro_radps"), _columns(samples, "acceleration_mps2")
    # A hand trembles: only the long pose on the floor has to be without any movement.
    trembling = 1.0 if count == _REST_SAMPLES else 10.0
    if gyro.std(axis=0).max() > _STILL_RADPS * trembling or acceleration.std(axis=0).max() > _STILL_MPS2 * trembling:
        raise CalibrationError("the robot was not held still; try again")
    return samples


def _columns(samples: list[ImuSample], name: str) -> Vector:
    """(N, 3)"""
    return np.array([getattr(sample, name) for sample in samples], np.float64)


def _axes(towards: tuple[Vector, Vector, Vector], least: float, what: str) -> tuple[Axis, Axis, Axis]:
    """Which axis of the chip is meant by each of three measured directions (forward, left, up)."""
    names: list[Axis] = []
    for direction, name in zip(towards, ("forward", "left", "up"), strict=True):
        order = np.argsort(-np.abs(direction))
        most, next_most = np.abs(direction[order[:2]])
        if most < least or most < _CLEAR * next_most:
            raise CalibrationError(
                f"by its {what}, no axis of the IMU points {name}: lift and turn it farther, about one axis at a time, "
                "and mount the chip square to the robot"
            )
        names.append(cast("Axis", ("-" if direction[order[0]] < 0 else "") + "xyz"[order[0]]))
    if len({name[-1] for name in names}) < 3:
        raise CalibrationError(f"by its {what}, two directions are the same axis ({', '.join(names)}); try again")
    return names[0], names[1], names[2]


def _mapped(chip: Vector, axes: tuple[Axis, Axis, Axis]) -> Vector:
    """(N, 3) of robot axes."""
    return np.column_stack([(-1.0 if a.startswith("-") else 1.0) * chip[:, "xyz".index(a[-1])] for a in axes])
