"""Datagrams to observations; foreign, damaged, repeated and outdated ones are counted and dropped, never an error."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np

from shared.messages import Observation
from shared.protocol.compact.encoder import CHECK_BYTES, KEYFRAME, NUMBERS, WINDOW, check_of
from shared.protocol.compact.model import Coding
from shared.protocol.compact.state import State, Unfit
from shared.protocol.compact.walk import code_observation

_LONGEST_BYTES = 65_000
_WANTS_KEYFRAME = 0x10
_DAMAGED_MEANS_LOST = 3


@dataclass(slots=True)
class CompactCounts:
    """What came in."""

    good: int = 0
    keyframes: int = 0  # of the good ones
    damaged: int = 0  # the check is wrong, or the values are none
    without_base: int = 0  # predicted from what this side does not have
    outdated: int = 0  # older than what came last, or that again
    reduced: int = 0  # of the good ones: detail was left out


class Decoder:
    """One session's receiving side."""

    def __init__(self, check_bytes: int = CHECK_BYTES) -> None:
        """`check_bytes`: as the encoder has it."""
        self.counts = CompactCounts()
        self._head_bytes = 1 + check_bytes
        self._states: OrderedDict[int, State] = OrderedDict()
        self._newest: int | None = None
        self._lost = False
        self._damaged_in_row = 0

    def decode(self, datagram: bytes) -> Observation | None:
        """The observation, or None. Never raises."""
        head_bytes = self._head_bytes
        if not head_bytes <= len(datagram) <= _LONGEST_BYTES or self._head_is_none(datagram[0]):
            self.counts.damaged += 1
            return None
        base = self._base(datagram[0])
        if base is None:
            self.counts.without_base += 1
            self._lost = True
            return None
        state = base.copy()
        payload = np.frombuffer(datagram, np.uint8)[head_bytes:].copy()
        coding = Coding(state.model, payload, len(payload), reading=True)
        try:
            observation, level, _ = code_observation(coding, state, None)
        except Unfit:
            self._drop_damaged()
            return None
        check = check_of(datagram[:1] + datagram[head_bytes:], state, head_bytes - 1)
        if not coding.has_ended() or check != datagram[1:head_bytes]:
            self._drop_damaged()
            return None
        return self._accept(datagram[0], state, observation, level)

    @property
    def wants_keyframe(self) -> bool:
        """Nothing that is not one can be understood."""
        return self._newest is None or self._lost

    def feedback(self) -> bytes:
        """Three bytes for `Encoder.acknowledge`: the newest state that is here, or that a keyframe is wanted."""
        if self._newest is None or self._lost:
            return bytes((_WANTS_KEYFRAME, 0, 0))
        return bytes((self._newest,)) + (self._states[self._newest].digest & 0xFFFF).to_bytes(2, "little")

    def _head_is_none(self, head: int) -> bool:
        return bool(head & KEYFRAME) and bool(head & 0x07)

    def _base(self, head: int) -> State | None:
        if head & KEYFRAME:
            return State.initial()
        return self._states.get(((head >> 3) - 1 - (head & 0x07)) % NUMBERS)

    def _drop_damaged(self) -> None:
        """One may be damaged on its way; several in a row mean that the two sides have come to differ."""
        self.counts.damaged += 1
        self._damaged_in_row += 1
        self._lost |= self._damaged_in_row >= _DAMAGED_MEANS_LOST

    def _accept(self, head: int, state: State, observation: Observation, level: int) -> Observation | None:
        newest = self._states[self._newest] if self._newest is not None else None
        if newest is not None and newest.boot_id == state.boot_id and state.sequence <= newest.sequence:
            self.counts.outdated += 1
            return None
        number = head >> 3 & 0x0F
        if head & KEYFRAME:
            self.counts.keyframes += 1
        self._states[number] = state
        self._states.move_to_end(number)
        while len(self._states) > WINDOW:
            self._states.popitem(last=False)
        self._newest = number
        self._lost = False
        self._damaged_in_row = 0
        self.counts.good += 1
        self.counts.reduced += level > 0
        return observation
