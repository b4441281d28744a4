from __future__ import annotations

import numpy as np
import pytest

from robot_app.drivers.arrival import ArrivalFilter, WrappingCounter


def test_delays_of_the_host_are_taken_out(rng: np.random.Generator) -> None:
    arrival = ArrivalFilter()
    device_s = np.arange(400) * 0.028
    true_s = 5.0 + device_s * (1 + 5e-5)
    late_s = true_s + rng.exponential(0.004, 400)
    found_s = np.array([arrival.arrival_s(d, t) for d, t in zip(device_s, late_s, strict=True)])
    assert np.abs(found_s - true_s)[100:].max() < 0.0015
    assert np.all(found_s <= late_s + 1e-12)


def test_a_sample_that_waited_long_keeps_its_place() -> None:
    arrival = ArrivalFilter()
    arrival.arrival_s(0.0, 10.0)
    assert arrival.arrival_s(0.028, 40.0) == pytest.approx(10.028 + 30 * 2e-4)


def test_a_device_clock_that_was_set_is_followed() -> None:
    arrival = ArrivalFilter()
    arrival.arrival_s(50_000.0, 10.0)
    assert arrival.arrival_s(0.0, 10.1) == 10.1
    assert arrival.arrival_s(1.6e9, 10.2) == pytest.approx(10.2)


def test_a_counter_wraps_and_does_not_mind_going_back() -> None:
    counter = WrappingCounter(24, 0.001)
    assert counter.seconds(0xFFFFFE) == 0.0
    assert counter.seconds(3) == pytest.approx(0.005)
    assert counter.seconds(1) == pytest.approx(0.003)
