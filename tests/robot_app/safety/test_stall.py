from __future__ import annotations

import math

import pytest

from robot_app.safety.stall import StallConfig, StallWatch


@pytest.fixture
def watch() -> StallWatch:
    return StallWatch(StallConfig(duty=0.25, speed_mps=0.03, for_s=0.4))


def seconds_to_stall(watch: StallWatch, duty: float, speed_mps: float) -> float:
    return next((i / 100 for i in range(200) if watch.update(i / 100, duty, speed_mps)), math.inf)


def test_a_motor_that_pushes_and_hardly_turns_is_stalled(watch: StallWatch) -> None:
    assert 0.4 <= seconds_to_stall(watch, 0.9, 0.015) < 0.42


@pytest.mark.parametrize("duty", [0.3, 0.6, -0.6])
def test_without_any_tick_it_is_stalled_as_soon_as_a_free_car_would_have_made_some(
    watch: StallWatch, duty: float
) -> None:
    assert 0.05 < seconds_to_stall(watch, duty, 0.0) < 0.2
    assert abs(watch.free_mps) < 0.25
    assert watch.free_mps * duty > 0


def test_pushes_that_are_over_do_not_add_up(watch: StallWatch) -> None:
    for start_s in (0.0, 1.0, 2.0):
        assert not any(watch.update(start_s + i / 100, 0.3, 0.0) for i in range(8))
        watch.forget()


@pytest.mark.parametrize(("duty", "speed"), [(0.9, 0.2), (0.1, 0.0), (-0.9, -0.2), (0.0, 0.0)])
def test_a_motor_that_turns_or_gets_little_is_not_stalled(watch: StallWatch, duty: float, speed: float) -> None:
    assert not any(watch.update(0.1 * i, duty, speed) for i in range(50))


def test_a_start_that_takes_a_moment_is_not_a_stall(watch: StallWatch) -> None:
    assert not any(watch.update(i / 100, 0.5, 0.0) for i in range(5))
    assert not any(watch.update(i / 100, 0.5, 0.015) for i in range(5, 30))
    assert not watch.update(0.3, 0.5, 0.1)
