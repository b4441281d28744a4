"""Notices that going on round the room brings nothing: it is blocked, gets nowhere, or sees nothing new."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from shared.geometry.se2 import Pose2


@dataclass(frozen=True, slots=True)
class RoundConfig:
    blocked_s: float = 2.0  # without a way on
    away_m: float = 0.6  # getting somewhere
    patience_s: float = 12.0  # without getting there: a plan finds a way out sooner than trying does
    way_m: float = 6.0  # driven …
    growth_m2: float = 0.05  # … without seeing more new floor than this


class RoundWatch:
    """Step it while the wall is followed."""

    def __init__(self, config: RoundConfig) -> None:
        self._config = config
        self.reset()

    def reset(self) -> None:
        self.go_on()
        self._seen: deque[tuple[float, float]] = deque(maxlen=400)  # metres driven, floor seen

    def go_on(self) -> None:
        """After a pause, which does not count as time without getting anywhere."""
        self._free_s: float | None = None
        self._anchor: tuple[Pose2, float] | None = None

    def is_over(
        self, now_s: float, odom_from_robot: Pose2, distance_m: float, is_blocked: bool, seen_m2: float
    ) -> bool:
        """After `distance_m` driven, with so much floor seen."""
        config = self._config
        if self._free_s is None or not is_blocked:
            self._free_s = now_s
        if self._anchor is None or self._anchor[0].distance_m(odom_from_robot) > config.away_m:
            self._anchor = odom_from_robot, now_s
        if not self._seen or distance_m - self._seen[-1][0] > 0.05:
            self._seen.append((distance_m, seen_m2))
        while distance_m - self._seen[0][0] > config.way_m:
            grown_m2 = seen_m2 - self._seen.popleft()[1]
            if grown_m2 < config.growth_m2:
                return True
        return now_s - self._free_s > config.blocked_s or now_s - self._anchor[1] > config.patience_s
