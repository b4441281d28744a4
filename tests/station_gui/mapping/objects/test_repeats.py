from __future__ import annotations

import numpy as np

from shared.geometry.se2 import Pose2
from station_gui.mapping.objects.repeats import Repeats

PIECES_M = np.array([[[1.0, 0.2, 0.0], [1.0, 0.2, 0.5]], [[1.0, 0.2, 0.5], [1.0, -0.2, 0.5]]])
THERE = Pose2(0.3, -0.1, 0.4)


def seen_from(pose: Pose2, pieces_m: np.ndarray) -> np.ndarray:
    """Robot frame, in whole millimetres as they are recorded."""
    return np.round(pose.inverse().apply_3d(pieces_m.reshape(-1, 3)).reshape(-1, 2, 3), 3)


def test_what_stays_where_it_was_is_a_repeat_from_wherever_it_is_said() -> None:
    repeats = Repeats()
    assert repeats.is_measurement(seen_from(Pose2(), PIECES_M), Pose2())
    assert not repeats.is_measurement(seen_from(THERE, PIECES_M), THERE)


def test_what_is_a_little_elsewhere_was_measured_anew() -> None:
    repeats = Repeats()
    repeats.is_measurement(seen_from(Pose2(), PIECES_M), Pose2())
    noisy_m = PIECES_M + np.random.default_rng(1).normal(0.0, 0.008, PIECES_M.shape)
    assert repeats.is_measurement(seen_from(THERE, noisy_m), THERE)


def test_an_empty_image_measures_nothing() -> None:
    repeats = Repeats()
    repeats.is_measurement(PIECES_M, Pose2())
    assert not repeats.is_measurement(np.zeros((0, 2, 3)), Pose2())
    assert repeats.is_measurement(PIECES_M, Pose2())
