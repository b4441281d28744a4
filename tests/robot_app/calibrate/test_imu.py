"""A chip that sits crooked on a robot that is lifted and turned."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import cast

import numpy as np
import pytest

from robot_app.calibrate.guide import CalibrationError
from robot_app.calibrate.imu import calibrate_imu
from robot_app.calibrate.magnetometer import calibrate_magnetometer, fit_ellipsoid
from robot_app.config import RobotConfig
from robot_app.drivers.base import ImuSample
from robot_app.drivers.config import Axis
from robot_app.drivers.lsm9ds1_magnetometer import MagneticSample, corrected_ut, symmetric
from shared.runtime.clock import ManualClock
from tests.robot_app.calibrate.scripted import Action, Operator, values

Axes = tuple[Axis, Axis, Axis]
G = 9.80665
GYRO_BIAS, ACCELERATION_BIAS = np.array([0.03, -0.02, 0.05]), np.array([0.3, -0.2, 0.4])  # robot axes
DEGREE = math.pi / 180


def rotation(axis: str, angle_rad: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -s, s
    return matrix


class Chip:
    """Says what it feels along its own axes, with noise."""

    def __init__(self, clock: ManualClock, gyro_axes: Axes, acceleration_axes: Axes) -> None:
        self._clock, self._gyro_axes, self._acceleration_axes = clock, gyro_axes, acceleration_axes
        self._random = np.random.default_rng(5)
        self._world_from_robot = np.eye(3)
        self._rate = np.zeros(3)
        self._last_s = -1.0
        self.trembling = 0.002

    def read(self, timeout_s: float) -> ImuSample | None:
        now_s = self._clock.now_s()
        if now_s - self._last_s < 0.009:
            return None
        self._last_s = now_s
        gyro = self._rate + GYRO_BIAS + self.trembling * self._random.standard_normal(3)
        up = self._world_from_robot.T @ np.array([0.0, 0.0, G])
        acceleration = up + ACCELERATION_BIAS + 0.03 * self._random.standard_normal(3)
        return ImuSample(now_s, _chip(gyro, self._gyro_axes), _chip(acceleration, self._acceleration_axes))

    def close(self) -> None:
        """Nothing to let go."""

    def turned(self, axis: str, angle_deg: float) -> Action:
        """Half a second of turning about an axis of the robot."""

        def action(meanwhile: Callable[[], None]) -> None:
            rate = np.zeros(3)
            rate["xyz".index(axis)] = angle_deg * DEGREE / 0.5
            for _ in range(50):
                self._rate = rate
                self._world_from_robot = self._world_from_robot @ rotation(axis, angle_deg * DEGREE / 50)
                self._clock.advance(0.01)
                meanwhile()
            self._rate = np.zeros(3)

        return action


def _chip(robot: np.ndarray[tuple[int], np.dtype[np.float64]], axes: Axes) -> tuple[float, float, float]:
    chip = [0.0, 0.0, 0.0]
    for value, axis in zip(robot.tolist(), axes, strict=True):
        chip["xyz".index(axis[-1])] = -value if axis.startswith("-") else value
    return chip[0], chip[1], chip[2]


def still(_: Callable[[], None]) -> None:
    """Hands off."""


def lifts(chip: Chip, nose_deg: float = 45.0, left_deg: float = 45.0, turn_deg: float = 90.0) -> list[Action]:
    nose, back = chip.turned("y", -nose_deg), chip.turned("y", nose_deg)
    left, down = chip.turned("x", left_deg), chip.turned("x", -left_deg)
    return [still, nose, back, left, down, chip.turned("z", turn_deg)]


@pytest.mark.parametrize(
    ("gyro_axes", "acceleration_axes"),
    [(("x", "y", "z"), ("x", "y", "z")), (("-y", "x", "z"), ("-y", "x", "z")), (("z", "-x", "-y"), ("y", "-z", "x"))],
)
def test_axes_and_biases_are_found(config: RobotConfig, gyro_axes: Axes, acceleration_axes: Axes) -> None:
    clock = ManualClock()
    chip = Chip(clock, gyro_axes, acceleration_axes)
    changes = calibrate_imu(chip, config, Operator(*lifts(chip)), clock)
    found = values(changes)
    assert found["gyro_axes"] == gyro_axes
    assert found["acceleration_axes"] == acceleration_axes
    assert found["gyro_bias_radps"] == pytest.approx(tuple(GYRO_BIAS), abs=5e-4)
    assert found["acceleration_bias_mps2"] == pytest.approx(tuple(ACCELERATION_BIAS), abs=0.01)
    assert "± 0.000" in changes[2].certainty


@pytest.mark.parametrize(
    ("lifted", "words"),
    [
        ({"nose_deg": 5.0}, "no axis of the IMU points forward"),
        ({"turn_deg": 3.0}, "by its turning, no axis of the IMU points up"),
    ],
)
def test_lifts_that_show_nothing_are_refused(config: RobotConfig, lifted: dict[str, float], words: str) -> None:
    clock = ManualClock()
    chip = Chip(clock, ("x", "y", "z"), ("x", "y", "z"))
    with pytest.raises(CalibrationError, match=words):
        calibrate_imu(chip, config, Operator(*lifts(chip, **lifted)), clock)


def test_a_robot_that_is_not_left_alone_is_told(config: RobotConfig) -> None:
    clock = ManualClock()
    chip = Chip(clock, ("x", "y", "z"), ("x", "y", "z"))
    chip.trembling = 0.1
    with pytest.raises(CalibrationError, match="not held still"):
        calibrate_imu(chip, config, Operator(*lifts(chip)), clock)


def directions(count: int, rng: np.random.Generator) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    every = rng.standard_normal((count, 3))
    return every / np.linalg.norm(every, axis=1, keepdims=True)


IRON = np.array([[1.15, 0.05, -0.03], [0.05, 0.95, 0.02], [-0.03, 0.02, 1.0]])
OFFSET_UT = np.array([25.0, -40.0, 12.0])


def test_the_robots_own_magnets_and_iron_are_found(rng: np.random.Generator) -> None:
    field = 46.0 * directions(2000, rng) @ np.linalg.inv(IRON).T + OFFSET_UT + 0.3 * rng.standard_normal((2000, 3))
    field[::50] += 30 * rng.standard_normal((40, 3))  # a door of steel is passed
    offset_ut, matrix, residual = fit_ellipsoid(field)
    assert offset_ut == pytest.approx(OFFSET_UT, abs=0.3)
    corrected = corrected_ut(field, offset_ut, matrix)
    sizes = np.delete(np.linalg.norm(corrected, axis=1), np.arange(0, 2000, 50))
    assert sizes.std() / sizes.mean() < 0.012
    assert residual < 0.012


def test_turning_about_one_axis_is_not_enough(rng: np.random.Generator) -> None:
    angle = rng.uniform(0, math.tau, 1000)
    flat = np.column_stack([30 * np.cos(angle), 30 * np.sin(angle), np.full(1000, -35.0)])
    with pytest.raises(CalibrationError, match="too few axes"):
        fit_ellipsoid(flat + 0.3 * rng.standard_normal((1000, 3)))


class Field:
    def __init__(self, field_ut: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> None:
        self._field = iter(field_ut.tolist())

    def read(self, timeout_s: float) -> MagneticSample | None:
        x, y, z = next(self._field)
        return MagneticSample(0.0, (x, y, z))

    def close(self) -> None:
        """Nothing to let go."""


def turned_for(samples: int) -> Action:
    def action(meanwhile: Callable[[], None]) -> None:
        for _ in range(samples):
            meanwhile()

    return action


def test_the_magnetometer_is_written_as_it_is_read(config: RobotConfig, rng: np.random.Generator) -> None:
    field = 46.0 * directions(1000, rng) @ np.linalg.inv(IRON).T + OFFSET_UT
    found = values(calibrate_magnetometer(Field(field), config, Operator(turned_for(1000))))
    corrected = corrected_ut(field, np.array(found["offset_ut"]), symmetric(cast("tuple[float, ...]", found["matrix"])))
    assert np.linalg.norm(corrected, axis=1).std() < 0.1


@pytest.mark.parametrize(("samples", "size_ut", "words"), [(100, 46.0, "only 100"), (1000, 150.0, "not the earth's")])
def test_a_field_that_is_not_the_earths_is_refused(
    config: RobotConfig, rng: np.random.Generator, samples: int, size_ut: float, words: str
) -> None:
    with pytest.raises(CalibrationError, match=words):
        calibrate_magnetometer(Field(size_ut * directions(1000, rng)), config, Operator(turned_for(samples)))
