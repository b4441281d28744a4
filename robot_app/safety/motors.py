"""Sets the motors, and stops them faster than the speed loop does: by hard braking, or by cutting them.

A motor that is only cut lets the car roll on for 0.3 s from 0.33 m/s. A push against the way, by the speed, takes half
of that. The measured speed is an average over 0.1 s: when it has fallen by half, the car nearly stands, and a push that
went on would send it back. Where the speed is not known any more, the push is that of the last one known and fades in
50 ms: a car that stops twice as fast as ours is sent back by 1.5 cm.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Protocol

from robot_app.drivers.base import DeviceError, Drive, Setting

_DUTY_PER_MPS = 1.2
_ENDS_AT = 0.5  # of the speed at its beginning
_BLIND_DUTY_PER_MPS = 1.7
_BLIND_FADES_S = 0.05  # the speed of the car with its motor cut fades in 0.09 to 0.12 s
_LASTS_S = 0.18
_LOCK_TIMEOUT_S = 0.05


class Brake(Protocol):
    """How a kind of robot is stopped hard."""

    def begin(self, now_s: float, speed_mps: float, is_blind: bool = False) -> None:
        """`speed_mps`: the last one that is known, 0: it stands; `is_blind`: what is measured from now on is wrong."""
        ...

    def push(self, now_s: float, speed_mps: float | None) -> Setting | None:
        """`speed_mps` as it is measured, None where it is not. None once the braking is over."""
        ...

    def standing(self) -> Setting:
        """Without a push."""
        ...


class HardBrake:
    """The car's: how much its one motor pushes against the way. `pushing`: the setting with a duty along it."""

    def __init__(self, pushing: Callable[[float], Setting]) -> None:
        self._pushing = pushing
        self._began_s = -math.inf
        self._from_mps = 0.0
        self._is_blind = False
        self._is_over = True

    def begin(self, now_s: float, speed_mps: float, is_blind: bool = False) -> None:
        self._is_blind = is_blind
        self._began_s, self._from_mps, self._is_over = now_s, speed_mps, speed_mps == 0.0

    def push(self, now_s: float, speed_mps: float | None) -> Setting | None:
        duty = self.duty(now_s, speed_mps)
        return self._pushing(duty) if duty else None

    def standing(self) -> Setting:
        return self._pushing(0.0)

    def duty(self, now_s: float, speed_mps: float | None) -> float:
        """0 once the braking is over."""
        elapsed_s = now_s - self._began_s
        speed_mps = None if self._is_blind else speed_mps
        self._is_over |= not 0 <= elapsed_s < _LASTS_S
        if speed_mps is not None:
            self._is_over |= speed_mps * self._from_mps < _ENDS_AT * self._from_mps**2
        if self._is_over:
            return 0.0
        if speed_mps is not None:
            duty = -_DUTY_PER_MPS * speed_mps
        else:
            duty = -_BLIND_DUTY_PER_MPS * self._from_mps * math.exp(-elapsed_s / _BLIND_FADES_S)
        return max(-1.0, min(1.0, duty))


class Motors:
    """`forget`: what the speed loop has wound up.

    `set` is for the control task, `brake` for any that finds that it does not work, `cut` for all.
    """

    def __init__(self, drive: Drive, brake: Brake, forget: Callable[[], None]) -> None:
        self._drive = drive
        self._brake = brake
        self._forget = forget
        self._lock = threading.Lock()
        self._drives = False
        self.applied: Setting | None = None  # None while they are cut

    def set(self, setting: Setting) -> Setting:
        with self._lock:
            self.applied = self._drive.set(setting)
            self._drives = True
            return self.applied

    def brake(self, now_s: float, speed_mps: float, is_known: bool, before_mps: float = 0.0) -> None:
        """Call it again and again until the car may drive; it stands cut in the end.

        `speed_mps` is the last that was measured and, where `is_known`, that of now; `before_mps`: what it was when the
        encoders began to tell something wrong. Does not wait for a thread that hangs.
        """
        waited = self._lock.acquire(timeout=_LOCK_TIMEOUT_S)
        try:
            self._forget()
            if self._drives or before_mps:
                self._brake.begin(now_s, before_mps or speed_mps, is_blind=before_mps != 0.0)
            self._drives = False
            setting = self._brake.push(now_s, speed_mps if is_known else None)
            if setting is None or not self._push(setting):
                self._stop()
        finally:
            if waited:
                self._lock.release()

    def check(self) -> None:
        """Whether the drive obeys while the car stands; raises its `DeviceError`."""
        if self.applied is None:
            self._drive.set(self._brake.standing())

    def cut(self) -> None:
        """At once and without a push. Waits for a tick under way, but not for one that hangs."""
        waited = self._lock.acquire(timeout=_LOCK_TIMEOUT_S)
        try:
            self._drives = False
            self._brake.begin(-math.inf, 0.0)
            self._stop()
            self._forget()
        finally:
            if waited:
                self._lock.release()

    def _push(self, setting: Setting) -> bool:
        """Whether the drive obeyed."""
        try:
            self.applied = self._drive.set(setting)
        except DeviceError:  # its own task tells it
            return False
        return True

    def _stop(self) -> None:
        self.applied = None
        self._drive.stop()
