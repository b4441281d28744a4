"""Observations over a link that may change to LoRa at any moment.

Each one is made in both profiles: Wi-Fi carries FULL with COMPACT behind it, LoRa COMPACT alone. So the two sides of
COMPACT stay in step whatever path an observation took, and neither a change of the path nor a return costs a keyframe.

FULL has the objects as this one depth image shows them, which tells a map most: each image is a measurement of its own.
COMPACT has them held still from image to image, for it is cheap to say that nothing has changed.

What a datagram is shows in its first byte: a multiple of 8 begins COMPACT in order, `_BOTH` the pair, anything else is
the version of `codec`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from shared.messages import Message, Observation
from shared.protocol import codec
from shared.protocol.compact.decoder import Decoder as CompactDecoder
from shared.protocol.compact.encoder import Encoder as CompactEncoder

_BOTH = 7
_BOTH_HEAD_BYTES = 3  # and the length of COMPACT
_CHECK_BYTES = 1  # the link checks; it shows when the two sides have come to differ


@dataclass(frozen=True, slots=True)
class EncodedObservation:
    full: bytes  # with the compact one behind it
    compact: bytes | None  # None for what cannot be said so: then `full` travels on every path
    keyframe: bool = False


class ObservationEncoder:
    """The robot's side. What is encoded must be sent, in its order; `reset` where that was not possible."""

    def __init__(self, steadied: Callable[[Observation], Observation]) -> None:
        """`steadied`: an observation with its objects held as they were said before, as far as that is still true."""
        self._compact = CompactEncoder(in_order=True, check_bytes=_CHECK_BYTES)
        self._steadied = steadied

    def reset(self) -> None:
        """The other side may have nothing: the next one stands for itself."""
        self._compact.reset()

    def encode(self, observation: Observation, max_compact_bytes: int | None = None) -> EncodedObservation:
        """Above `max_compact_bytes` detail is left out of the compact version, as far as it can be."""
        full = codec.encode(observation)
        try:
            encoded = self._compact.encode(self._steadied(observation), max_compact_bytes)
        except ValueError:
            return EncodedObservation(full, None)
        compact = encoded.datagram
        both = bytes((_BOTH,)) + len(compact).to_bytes(_BOTH_HEAD_BYTES - 1, "little") + compact + full
        return EncodedObservation(both, compact, encoded.keyframe)


@dataclass(frozen=True, slots=True)
class Received:
    """`datagram`: as `codec` has it, whatever came: it needs nothing that came before, and is what is recorded."""

    message: Message
    datagram: bytes
    was_compact: bool = False


class MessageDecoder:
    """Decodes everything that one side of a link may say, and counts what could not be decoded. Never raises."""

    def __init__(self, compact: bool) -> None:
        """`compact`: the link lets in nobody else's bytes, as one with a radio does; its check is short."""
        self._codec = codec.Decoder()
        self._takes_compact = compact
        self._compact = CompactDecoder(_CHECK_BYTES)
        self.wants_keyframe = False
        self.counts = self._codec.counts

    def decode(self, datagram: bytes) -> Received | None:
        if self._takes_compact and datagram and datagram[0] & 7 == 0:
            return self._decode_compact(datagram)
        if self._takes_compact and datagram and datagram[0] == _BOTH:
            length = int.from_bytes(datagram[1:_BOTH_HEAD_BYTES], "little")
            self._follow(datagram[_BOTH_HEAD_BYTES : _BOTH_HEAD_BYTES + length])
            datagram = datagram[_BOTH_HEAD_BYTES + length :]
        message = self._codec.decode(datagram)
        return None if message is None else Received(message, datagram)

    def _decode_compact(self, datagram: bytes) -> Received | None:
        observation = self._follow(datagram)
        if observation is None:
            self.counts.malformed += 1
            return None
        recorded = codec.encode(observation)
        again = codec.Decoder().decode(recorded)  # so that a recording gives the same map again, to the last bit
        return None if again is None else Received(again, recorded, was_compact=True)

    def _follow(self, compact: bytes) -> Observation | None:
        observation = self._compact.decode(compact)
        self.wants_keyframe = self._compact.wants_keyframe
        return observation
