"""Which closures are believed."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.closures.closure import Closure
from station_gui.mapping.slam2d.config import LoopConfig
from station_gui.mapping.slam2d.se2_arrays import between, compose

FloatArray = NDArray[np.float64]

_MAX_UNCONFIRMED = 30


class Jury:
    """What agrees with the nodes' poses is believed; what does not needs a second closure that says the same."""

    def __init__(self, config: LoopConfig) -> None:
        self._config = config
        self._unconfirmed: deque[Closure] = deque(maxlen=_MAX_UNCONFIRMED)

    def judge(self, closure: Closure, poses: FloatArray) -> list[Closure]:
        """Those that are believed now; `poses`: (nodes, 3)."""
        if not closure.searched or (not closure.partial and self._near(closure, poses)):
            return [closure]
        agreeing = [other for other in self._unconfirmed if self._agree(other, closure, poses)]
        if not agreeing:
            self._unconfirmed.append(closure)
            return []
        for other in agreeing:
            self._unconfirmed.remove(other)
        return [*agreeing, closure]

    def _near(self, closure: Closure, poses: FloatArray) -> bool:
        """Where the estimate has it too."""
        expected = compose(poses[closure.old], closure.measured)
        correction = between(poses[closure.new], expected)
        return bool(np.hypot(correction[0], correction[1]) < self._config.agreement_m)

    def _agree(self, a: Closure, b: Closure, poses: FloatArray) -> bool:
        """Both closures move the new place in the same way.

        None of the scans that say so is in both, unless the estimate has a say too: both are near it.
        """
        config = self._config
        apart = abs(a.new - b.new)
        if not 0 < apart <= config.agreement_nodes or (a.witness and b.witness):
            return False
        if apart <= 2 * config.query_neighbours and not (self._near(a, poses) and self._near(b, poses)):
            return False
        by_a = compose(compose(poses[a.old], a.measured), between(poses[a.new], poses[b.new]))
        difference = between(compose(poses[b.old], b.measured), by_a)
        return bool(
            np.hypot(difference[0], difference[1]) < config.agreement_m and abs(difference[2]) < config.agreement_rad
        )
