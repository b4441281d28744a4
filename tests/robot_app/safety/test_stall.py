from __future__ import annotations

import pytest

from robot_app.safety.stall import StallConfig, StallWatch


@pytest.fixture
def watch() -> StallWatch:
    return StallWatch(StallConfig(duty=0.25, speed_mps=0.03, for_s=0.4))


def test_a_motor_that_pushes_without_turning_is_stalled(watch: StallWatch) -> None:
    assert not watch.update(1.0, 0.9, 0.0)
    assert not watch.update(1.3, 0.9, 0.01)
    assert watch.update(1.45, 0.9, 0.0)


@pytest.mark.parametrize(("duty", "speed"), [(0.9, 0.2), (0.1, 0.0), (-0.9, -0.2), (0.0, 0.0)])
def test_a_motor_that_turns_or_gets_little_is_not_stalled(watch: StallWatch, duty: float, speed: float) -> None:
    assert not any(watch.update(0.1 * i, duty, speed) for i in range(50))


def test_reverse_stalls_as_well(watch: StallWatch) -> None:
    assert any(watch.update(0.1 * i, -0.9, 0.0) for i in range(10))


def test_a_start_that_takes_a_moment_is_not_a_stall(watch: StallWatch) -> None:
    assert not watch.update(0.0, 0.5, 0.0)
    assert not watch.update(0.3, 0.5, 0.1)
    assert not watch.update(0.6, 0.5, 0.0)
