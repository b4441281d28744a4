from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from station_gui.mapping.slam2d.config import MatchConfig, MotionConfig
from station_gui.mapping.slam2d.matching.scan_matcher import Match
from station_gui.mapping.slam2d.motion import MotionModel
from station_gui.mapping.slam2d.se2_arrays import compose

FloatArray = NDArray[np.float64]


def _model() -> MotionModel:
    return MotionModel(MotionConfig(), MatchConfig())


def _match(pose: FloatArray, points_x: float, points_y: float) -> Match:
    """That so many points hold along x and y of the map."""
    noise_m = MatchConfig().noise_m
    return Match(pose, np.diag((points_x, points_y, 100.0)) / noise_m**2, 0.9, 0.01)


def _drive(model: MotionModel, odometry: FloatArray, true_step: FloatArray, scans: int, points_x: float) -> None:
    pose = np.zeros(3)
    for _ in range(scans):
        after = compose(pose, true_step)
        model.learn(odometry, pose, _match(after, points_x, 200.0))
        pose = after


def test_wheels_that_slip_are_believed_less_once_the_scans_have_shown_it() -> None:
    model = _model()
    _drive(model, np.array([0.1, 0.0, 0.0]), np.array([0.095, 0.0, 0.0]), 1000, points_x=200.0)
    assert model.scale == pytest.approx(0.95, abs=0.006)
    np.testing.assert_allclose(model.predict(np.array([0.2, 0.0, 0.1])).motion, [0.19, 0.0, 0.1], atol=0.002)


def test_along_a_bare_corridor_nothing_is_learnt() -> None:
    model = _model()
    _drive(model, np.array([0.1, 0.0, 0.0]), np.array([0.08, 0.0, 0.0]), 1000, points_x=10.0)
    assert model.scale == 1.0


def test_wheels_that_spin_do_not_spoil_the_scale() -> None:
    model = _model()
    _drive(model, np.array([0.1, 0.0, 0.0]), np.array([0.01, 0.0, 0.0]), 300, points_x=200.0)
    assert model.scale == 1.0


def test_without_odometry_the_robot_is_taken_to_go_on_as_before() -> None:
    model, step = _model(), np.array([0.06, 0.0, math.radians(3.0)])
    _drive(model, np.zeros(3), step, 10, points_x=200.0)
    prediction = model.predict(np.zeros(3))
    np.testing.assert_allclose(prediction.motion, step, atol=1e-12)
    assert prediction.sigma[0] == MotionConfig().silent_shift_m


@pytest.mark.parametrize("points_x", [5.0, 200.0])
def test_a_robot_that_stands_is_not_taken_to_go_on(points_x: float) -> None:
    """Neither in a corridor, where scans do not say, nor when the odometry has been heard before."""
    model = _model()
    _drive(model, np.array([0.1, 0.0, 0.0]), np.array([0.1, 0.0, 0.0]), 50, points_x=200.0)
    _drive(model, np.zeros(3), np.array([0.05, 0.0, 0.0]), 4 if points_x > 100 else 50, points_x)
    np.testing.assert_array_equal(model.predict(np.zeros(3)).motion, np.zeros(3))


def test_odometry_that_comes_back_is_heard_again() -> None:
    model = _model()
    _drive(model, np.zeros(3), np.array([0.06, 0.0, 0.0]), 10, points_x=200.0)
    _drive(model, np.array([0.06, 0.0, 0.0]), np.array([0.06, 0.0, 0.0]), 1, points_x=200.0)
    np.testing.assert_array_equal(model.predict(np.zeros(3)).motion, np.zeros(3))


def test_a_lost_robot_without_odometry_comes_to_a_stop() -> None:
    model = _model()
    _drive(model, np.zeros(3), np.array([0.06, 0.0, 0.0]), 10, points_x=200.0)
    for _ in range(20):
        model.miss()
    assert float(np.abs(model.predict(np.zeros(3)).motion).max()) < 1e-6
