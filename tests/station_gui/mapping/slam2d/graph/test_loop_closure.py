from __future__ import annotations

import numpy as np
import pytest

from station_gui.mapping.slam2d.graph.loop_closure import without_weak_direction


def test_a_direction_that_many_points_hold_is_kept() -> None:
    information = np.diag((60.0, 200.0, 500.0))
    np.testing.assert_allclose(without_weak_direction(information, 0.05), information, rtol=0.03)


@pytest.mark.parametrize("angle_rad", [0.0, 0.7])
def test_along_a_bare_corridor_little_is_believed_and_across_it_all(angle_rad: float) -> None:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    weak = without_weak_direction(turn @ np.diag((1.0, 200.0, 500.0)) @ turn.T, 0.05)
    np.testing.assert_allclose(turn.T @ weak @ turn, np.diag((0.01, 200.0, 500.0)), atol=2e-3)


def test_what_nothing_holds_stays_nothing() -> None:
    assert not without_weak_direction(np.zeros((3, 3)), 0.05).any()
