"""Datagrams of profile COMPACT, and the three bytes that answer them."""

from __future__ import annotations

import numpy as np

from shared.protocol.compact.decoder import Decoder
from shared.protocol.compact.encoder import Encoder
from tools.fuzz.base import Verdict
from tools.fuzz.foreign import Strangers
from tools.fuzz.room_drive import drive, endless

_OBSERVATIONS = 300
_LONGEST_RANDOM = 120
_FOREIGN_TO_A_SOUND_ONE = 20


class Compact:
    """It must take every sound datagram and nothing else, whatever was thrown between two of them."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._encoder, self._decoder = Encoder(), Decoder()
        self._strangers = Strangers(rng, _LONGEST_RANDOM)
        self._observations = endless(drive(_OBSERVATIONS, rng))
        self._foreign = self._forgeries = self._taken = self._refused = 0

    def throw(self) -> int:
        sound = self._encoder.encode(next(self._observations)).datagram
        offered = len(sound)
        for _ in range(_FOREIGN_TO_A_SOUND_ONE):
            data = self._strangers.next(sound)
            if data != sound:
                offered += len(data)
                self._foreign += 1
                self._forgeries += self._decoder.decode(data) is not None
        taken = self._decoder.decode(sound) is not None
        self._taken += taken
        self._refused += not taken
        self._encoder.acknowledge(self._rng.bytes(3))
        self._encoder.acknowledge(self._decoder.feedback())
        self._strangers.remember(sound)
        return offered

    def verdict(self) -> Verdict:
        return Verdict(self._foreign, self._forgeries, self._taken, self._refused)
