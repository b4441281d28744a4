"""Reads a device for a while."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TypeVar

from robot_app.calibrate.guide import CalibrationError
from shared.runtime.clock import Clock

T = TypeVar("T")
_PATIENCE = 3.0  # as many times as long as planned


def pause(clock: Clock, seconds: float) -> None:
    clock.wait(threading.Event(), clock.now_s() + seconds)


def collect(clock: Clock, count: int, every_s: float, read: Callable[[], T | None], device: str) -> list[T]:
    """`count` samples. Raises `CalibrationError` when they do not come."""
    samples: list[T] = []
    due_s = clock.now_s() + _PATIENCE * count * every_s + 1.0
    while len(samples) < count:
        sample = read()
        if sample is not None:
            samples.append(sample)
        elif clock.now_s() > due_s:
            raise CalibrationError(f"the {device} sends too little; look at it with: robot-app check")
        pause(clock, every_s)
    return samples
