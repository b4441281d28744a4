"""How many bytes an observation may take over LoRa, so that the operator's picture keeps its pace.

Detail degrades before rate: where the link cannot carry whole observations as often as wanted, each gets the share of
what the link was measured to carry, and what it leaves out follows when there is room.
"""

from __future__ import annotations

import math

_SMOOTHING = 0.15  # of bytes and seconds, of the newest observation
_GROWTH = 1.15  # of the share while the link is not the limit
_LEAST_BYTES = 40  # with less an observation says little but where the robot is
_LONGEST_S = 2.0  # between two observations: after more the link was not slow but away
_MOST_BYTES = 400  # more than any takes but the first


class Budget:
    """Sans-I/O: tell it when an observation was handed over, and whether it had to wait for the link."""

    def __init__(self, wanted_hz: float) -> None:
        self._wanted_s = 1.0 / wanted_hz
        self._bytes = self._seconds = 0.0  # smoothed, of observations that had to wait
        self._last_s = math.nan
        self._last_bytes = 0
        self._limit = float(_MOST_BYTES)

    @property
    def most_bytes(self) -> int:
        """For the next observation."""
        return round(self._limit)

    @property
    def goodput_bps(self) -> float:
        """What the link carried when it was the limit; NaN before it ever was."""
        return 8.0 * self._bytes / self._seconds if self._seconds else math.nan

    def sent(self, now_s: float, size: int, waited: bool) -> None:
        """An observation of `size` bytes was handed over; `waited`: it had been ready before there was room."""
        taken_s = now_s - self._last_s
        if waited and taken_s < _LONGEST_S:
            weight = _SMOOTHING if self._seconds else 1.0
            self._bytes += weight * (self._last_bytes - self._bytes)
            self._seconds += weight * (taken_s - self._seconds)
            if taken_s > self._wanted_s:
                self._limit = min(self._limit, self._bytes / self._seconds * self._wanted_s)
            else:
                self._limit *= min(self._wanted_s / max(taken_s, 1e-3), _GROWTH)
        elif not waited:
            self._limit *= _GROWTH
        self._limit = min(max(self._limit, _LEAST_BYTES), _MOST_BYTES)
        self._last_s, self._last_bytes = now_s, size
