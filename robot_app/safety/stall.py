"""Notices a motor that gets current while the wheels, by their encoders, do not turn.

Either the car pushes against something or the encoders have failed; a car whose speed is not known must not drive.
Where no tick comes at all, a model of the free car tells how far it would be by now, and how fast.
"""

from __future__ import annotations

from dataclasses import dataclass

_LONGEST_STEP_S = 0.1


@dataclass(frozen=True, slots=True)
class StallConfig:
    duty: float = 0.25  # well above what it takes to begin to turn
    speed_mps: float = 0.03
    for_s: float = 0.40  # slower than this for so long
    no_tick_mps: float = 0.01  # one tick in the odometry's 0.1 s is 0.015 m/s
    free_m: float = 0.010  # a free car has gone so far, three ticks of each encoder, and none came
    full_duty_mps: float = 0.70  # of the free car …
    rise_s: float = 0.12  # … which it nears with this time constant

    def __post_init__(self) -> None:
        if not (0 < self.duty <= 1 and 0 < self.speed_mps <= 0.2 and 0 < self.for_s <= 2):
            raise ValueError("duty must be up to 1, speed_mps up to 0.2 and for_s up to 2, and all above 0")
        if not (0 < self.free_m <= 0.1 and 0 < self.full_duty_mps <= 3 and 0 < self.rise_s <= 1):
            raise ValueError("free_m must be up to 0.1, full_duty_mps up to 3 and rise_s up to 1, and all above 0")


class StallWatch:
    def __init__(self, config: StallConfig) -> None:
        self._config = config
        self.forget()

    def forget(self) -> None:
        self._last_s: float | None = None
        self._since_s: float | None = None
        self._forget_way()

    def _forget_way(self) -> None:
        self.free_mps = self._free_m = 0.0  # how fast it would be, were the wheels free and the encoders dead

    def update(self, now_s: float, duty: float, speed_mps: float) -> bool:
        """Whether the motor is stalled. `duty` as it was last set, `speed_mps` as the encoders say."""
        c = self._config
        if abs(duty) < c.duty:
            self.forget()
            return False
        step_s = 0.0 if self._last_s is None else min(max(now_s - self._last_s, 0.0), _LONGEST_STEP_S)
        self._last_s = now_s
        if abs(speed_mps) > c.no_tick_mps:
            self._forget_way()
        else:
            self.free_mps += (duty * c.full_duty_mps - self.free_mps) * step_s / (step_s + c.rise_s)
            self._free_m += abs(self.free_mps) * step_s
        if abs(speed_mps) > c.speed_mps:
            self._since_s = None
        elif self._since_s is None:
            self._since_s = now_s
        is_slow = self._since_s is not None and now_s - self._since_s >= c.for_s
        return is_slow or self._free_m >= c.free_m
