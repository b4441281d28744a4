"""Which packets the air swallows although they are strong enough."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np


class LossModel(Protocol):
    """The state of one direction between two antennas; asked once for each packet, in the order of time."""

    def lost(self, time_s: float, rng: np.random.Generator) -> bool: ...


@dataclass(frozen=True, slots=True)
class Independent:
    """Each packet is lost with the same probability."""

    probability: float = 0.0

    def __post_init__(self) -> None:
        _require_probability(self.probability)

    def lost(self, time_s: float, rng: np.random.Generator) -> bool:
        del time_s
        return self.probability > 0.0 and bool(rng.random() < self.probability)


class Bursts:
    """Gilbert and Elliott's channel in continuous time: good and bad stretches of exponential lengths."""

    def __init__(self, mean_good_s: float, mean_bad_s: float, good_loss: float = 0.0, bad_loss: float = 1.0) -> None:
        if min(mean_good_s, mean_bad_s) <= 0:
            raise ValueError("mean_good_s and mean_bad_s must be positive")
        _require_probability(good_loss)
        _require_probability(bad_loss)
        self._mean_s = {False: mean_good_s, True: mean_bad_s}
        self._loss = {False: good_loss, True: bad_loss}
        self._is_bad = False
        self._until_s: float | None = None

    def lost(self, time_s: float, rng: np.random.Generator) -> bool:
        if self._until_s is None:  # it has been going on for ever
            bad_share = self._mean_s[True] / (self._mean_s[True] + self._mean_s[False])
            self._is_bad = bool(rng.random() < bad_share)
            self._until_s = time_s + float(rng.exponential(self._mean_s[self._is_bad]))
        while self._until_s < time_s:
            self._is_bad = not self._is_bad
            self._until_s += float(rng.exponential(self._mean_s[self._is_bad]))
        return bool(rng.random() < self._loss[self._is_bad])


def _require_probability(value: float) -> None:
    if not 0.0 <= value <= 1.0:
        raise ValueError(f"a probability is 0 to 1, not {value:g}")
