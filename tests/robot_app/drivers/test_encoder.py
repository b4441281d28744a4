"""Encoders against edges that are scripted; the events are the kernel's own structures."""

from __future__ import annotations

import numpy as np
import pytest

from robot_app.drivers.base import DeviceError
from robot_app.drivers.config import EncoderConfig
from robot_app.drivers.encoder import EVENT, QuadratureEncoders
from shared.runtime.clock import ManualClock
from tools.simulator.devices.gpio import Bias, Edge, GpioChip

CONFIG = EncoderConfig(right_reversed=False)
LEFT, RIGHT = (5, 6), (16, 26)


def counts(encoders: QuadratureEncoders) -> tuple[int, int]:
    count = encoders.read(0.0)
    return count.left, count.right


def test_an_event_is_as_long_as_the_kernels() -> None:
    assert EVENT.itemsize == 48


def test_a_turn_has_eighty_ticks_forward_and_back(gpio: GpioChip) -> None:
    encoders = QuadratureEncoders(CONFIG, ManualClock())
    gpio.turn(*LEFT, edges=320)
    gpio.turn(*RIGHT, edges=-320)
    assert counts(encoders) == (80, -80)
    gpio.turn(*LEFT, edges=-320)
    gpio.turn(*RIGHT, edges=40)
    assert counts(encoders) == (0, -70)
    assert encoders.impossible_edges == 0
    encoders.close()


def test_any_walk_of_the_wheel_ends_where_the_wheel_is(gpio: GpioChip, rng: np.random.Generator) -> None:
    encoders = QuadratureEncoders(CONFIG, ManualClock())
    position = 0
    for step in rng.integers(-30, 31, 200).tolist():
        gpio.turn(*LEFT, edges=step)
        position += step
        assert encoders.read(0.0).left == position // 4
    encoders.close()


def test_a_wheel_that_trembles_on_an_edge_counts_nothing(gpio: GpioChip) -> None:
    encoders = QuadratureEncoders(CONFIG, ManualClock())
    for _ in range(50):
        gpio.set(LEFT[0], 1)
        gpio.set(LEFT[0], 0)
    assert counts(encoders) == (0, 0)
    encoders.close()


def test_a_mirrored_motor_counts_forward_as_well(gpio: GpioChip) -> None:
    encoders = QuadratureEncoders(EncoderConfig(left_reversed=True, right_reversed=True), ManualClock())
    gpio.turn(*LEFT, edges=-8)
    gpio.turn(*RIGHT, edges=-12)
    assert counts(encoders) == (2, 3)
    encoders.close()


def test_a_start_in_the_middle_of_a_tick_counts_right(gpio: GpioChip) -> None:
    gpio.turn(*LEFT, edges=2)
    encoders = QuadratureEncoders(CONFIG, ManualClock())
    gpio.turn(*LEFT, edges=400)
    assert counts(encoders) == (100, 0)
    assert encoders.impossible_edges == 0
    encoders.close()


def test_a_line_that_chatters_does_not_fill_the_log(gpio: GpioChip, caplog: pytest.LogCaptureFixture) -> None:
    encoders = QuadratureEncoders(CONFIG, ManualClock())
    for _ in range(100):
        gpio.turn(*LEFT, edges=5, lost=True)
        gpio.turn(*LEFT, edges=1)
        encoders.read(0.0)
    assert encoders.lost_edges == 495  # those before the first event have no number
    assert 2 <= len(caplog.records) <= 10
    encoders.close()


def test_lost_edges_are_counted_and_the_levels_read_again(gpio: GpioChip) -> None:
    encoders = QuadratureEncoders(CONFIG, ManualClock())
    gpio.turn(*LEFT, edges=8)
    assert counts(encoders) == (2, 0)
    gpio.turn(*LEFT, edges=5, lost=True)
    gpio.turn(*LEFT, edges=4)
    encoders.read(0.0)
    assert encoders.lost_edges == 5
    impossible = encoders.impossible_edges
    before = encoders.read(0.0).left
    gpio.turn(*LEFT, edges=40)
    assert encoders.read(0.0).left == before + 10
    assert encoders.impossible_edges == impossible
    encoders.close()


def test_the_count_is_answered_without_a_new_edge_too(gpio: GpioChip) -> None:
    clock = ManualClock(3.0)
    encoders = QuadratureEncoders(CONFIG, clock)
    assert encoders.read(0.0).stamp_s == 3.0
    clock.advance(1.0)
    assert encoders.read(0.001).stamp_s == 4.0
    encoders.close()


def test_the_kernel_is_asked_for_both_edges_and_a_long_queue(gpio: GpioChip) -> None:
    encoders = QuadratureEncoders(CONFIG, ManualClock())
    (request,) = gpio.requests
    assert (request.settings.edge_detection, request.settings.bias) == (Edge.BOTH, Bias.PULL_UP)
    assert request.buffer_size == 1024
    encoders.close()
    encoders.close()
    assert not gpio.used
    with pytest.raises(DeviceError, match="closed"):
        encoders.read(0.0)


def test_lines_in_use_are_named(gpio: GpioChip) -> None:
    gpio.used.add(16)
    with pytest.raises(DeviceError, match=r"/dev/gpiochip0, lines 5, 6, 16, 26: another program"):
        QuadratureEncoders(CONFIG, ManualClock())


def test_the_old_gpiod_is_refused(gpio: GpioChip, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "gpiod", type("Old", (), {"Chip": None})())
    with pytest.raises(DeviceError, match="old version 1"):
        QuadratureEncoders(CONFIG, ManualClock())
