"""Notices a motor that gets current while the wheels, by their encoders, do not turn.

Either the car pushes against something or the encoders have failed; a car whose speed is not known must not drive.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class StallConfig:
    duty: float = 0.25  # well above what it takes to begin to turn
    speed_mps: float = 0.03
    for_s: float = 0.40  # the wheels need up to 0.2 s to begin to turn, and to be seen turning

    def __post_init__(self) -> None:
        if not (0 < self.duty <= 1 and 0 < self.speed_mps <= 0.2 and 0 < self.for_s <= 2):
            raise ValueError("duty must be up to 1, speed_mps up to 0.2 and for_s up to 2, and all above 0")


class StallWatch:
    def __init__(self, config: StallConfig) -> None:
        self._config = config
        self._since_s: float | None = None

    def update(self, now_s: float, duty: float, speed_mps: float) -> bool:
        """Whether the motor is stalled. `duty` as it was last set, `speed_mps` as the encoders say."""
        if abs(duty) < self._config.duty or abs(speed_mps) > self._config.speed_mps:
            self._since_s = None
            return False
        if self._since_s is None:
            self._since_s = now_s
        return now_s - self._since_s >= self._config.for_s
