"""Datagrams of profiles FULL and ASCII, and FULL's in the frames of TCP."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np

from shared.geometry.se2 import Pose2
from shared.messages import (
    Ack,
    Drive,
    EmergencyStop,
    GoTo,
    Hello,
    Message,
    MissionState,
    NumberedCommand,
    Observation,
    Start,
    StopReason,
    Telemetry,
)
from shared.protocol import ascii as ascii_profile
from shared.protocol import codec as full_profile
from shared.protocol.frame import HEAD_BYTES, MAX_PAYLOAD_BYTES, FrameParser, pack
from shared.protocol.observations import MessageDecoder, ObservationEncoder
from tools.fuzz.base import Verdict, require
from tools.fuzz.foreign import Strangers, mutated
from tools.fuzz.room_drive import drive, endless

_OBSERVATIONS = 60
_LONGEST_RANDOM = 300
_FOREIGN_TO_A_SOUND_ONE = 20
_MOST_PORTION = 1_500
_CRC_BYTES = 4


def sound_messages(rng: np.random.Generator) -> list[Message]:
    """Of each kind that says something."""
    telemetry = Telemetry(
        3.25, MissionState.OBSERVE, StopReason.NONE, Pose2(0.5, 0.25, -1.0), 0.2, 0.1, -0.25, 6.61, 0.8, 51.5, 4.5, 3,
        0, ("camera: lost",),
    )  # fmt: skip
    hello = Hello("car", "1.0", ((0.3, 0.1), (0.3, -0.1), (-0.1, -0.1), (-0.1, 0.1)), 0.5)
    path = rng.uniform(-3, 3, (12, 3)).astype(np.float32)
    commands = (Start(), EmergencyStop(), Drive(0.3, -0.2), GoTo(1, path))
    numbered = [NumberedCommand(int(rng.integers(2**32)), command) for command in commands]
    return [*drive(_OBSERVATIONS, rng), telemetry, hello, Ack(7, False, "there is no path"), *numbered]


class Decoder(Protocol):
    def decode(self, datagram: bytes) -> Message | None: ...


class Datagrams:
    """One profile's decoder. What has the right checksum is no forgery: it may make sense or not, and must not harm."""

    def __init__(
        self,
        rng: np.random.Generator,
        encode: Callable[[Message], bytes],
        decoder: Decoder,
        with_checksum: Callable[[bytes], bytes],
    ) -> None:
        self._rng = rng
        self._sound = [encode(message) for message in sound_messages(rng)]
        self._known = set(self._sound)
        self._decoder = decoder
        self._with_checksum = with_checksum
        self._strangers = Strangers(rng, _LONGEST_RANDOM)
        self._foreign = self._forgeries = self._taken = self._refused = 0

    def throw(self) -> int:
        sound = self._sound[int(self._rng.integers(len(self._sound)))]
        offered = len(sound)
        for _ in range(_FOREIGN_TO_A_SOUND_ONE):
            data = self._strangers.next(sound)
            resealed = self._with_checksum(mutated(sound, self._rng))
            offered += len(data) + len(resealed)
            if data not in self._known:
                self._foreign += 1
                self._forgeries += self._decoder.decode(data) is not None
            self._decoder.decode(resealed)
        self._strangers.remember(sound)
        self._say(sound)
        return offered

    def _say(self, sound: bytes) -> None:
        taken = self._decoder.decode(sound) is not None
        self._taken += taken
        self._refused += not taken

    def verdict(self) -> Verdict:
        return Verdict(self._foreign, self._forgeries, self._taken, self._refused)


def full(rng: np.random.Generator) -> Datagrams:
    def sealed(damaged: bytes) -> bytes:
        content = damaged[:-_CRC_BYTES]
        return content + zlib.crc32(content).to_bytes(_CRC_BYTES, "little")

    return Datagrams(rng, full_profile.encode, full_profile.Decoder(), sealed)


def ascii_lines(rng: np.random.Generator) -> Datagrams:
    def sealed(damaged: bytes) -> bytes:
        head, _, body = damaged.partition(b"\n")
        return b" ".join(head.split(b" ")[:2]) + b" %08x\n" % zlib.crc32(body) + body

    return Datagrams(rng, ascii_profile.encode, ascii_profile.Decoder(), sealed)


class Frames:
    """What comes over TCP: frames in any portions, the decoder of profile FULL behind them."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._sound = [full_profile.encode(message) for message in sound_messages(rng)]
        self._known = set(self._sound)
        self._parser = FrameParser()
        self._decoder = full_profile.Decoder()
        self._strangers = Strangers(rng, _LONGEST_RANDOM)
        self._foreign = self._forgeries = self._taken = 0
        self._held_bytes = self._given_bytes = 0

    def throw(self) -> int:
        datagram = self._sound[int(self._rng.integers(len(self._sound)))]
        sound = pack(datagram)
        stream = bytearray()
        for _ in range(_FOREIGN_TO_A_SOUND_ONE):
            stream += self._strangers.next(sound)
            self._foreign += 1
        stream += sound
        self._strangers.remember(sound)
        self._feed(bytes(stream))
        return len(stream)

    def _feed(self, stream: bytes) -> None:
        at = 0
        while at < len(stream):
            portion = stream[at : at + int(self._rng.integers(1, _MOST_PORTION))]
            at += len(portion)
            self._held_bytes += len(portion)
            before = self._parser.dropped_bytes
            for datagram in self._parser.feed(portion):
                self._held_bytes -= HEAD_BYTES + len(datagram)
                known = datagram in self._known
                self._taken += known
                self._forgeries += not known and self._decoder.decode(datagram) is not None
            self._held_bytes -= self._parser.dropped_bytes - before
            most = HEAD_BYTES + MAX_PAYLOAD_BYTES + _MOST_PORTION
            require(0 <= self._held_bytes <= most, f"the parser holds {self._held_bytes} bytes")

    def verdict(self) -> Verdict:
        """A damaged length may swallow what follows, but no more than one frame can hold."""
        taken, sound = self._taken, pack(self._sound[0])
        self._feed(sound * (MAX_PAYLOAD_BYTES // len(sound) + 2))
        require(self._taken > taken, "sound frames are not found again")
        return Verdict(self._foreign, self._forgeries, self._taken, 0)


class LinkMessages:
    """All that a link with a radio may bring: FULL, COMPACT with its short check, both in one.

    Such a link lets in nobody else's bytes; what it brings all the same must do no harm and may be taken for anything.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._encoder, self._decoder = ObservationEncoder(lambda o: o), MessageDecoder(compact=True)
        self._observations = endless(drive(_OBSERVATIONS, rng))
        self._others = [full_profile.encode(m) for m in sound_messages(rng) if not isinstance(m, Observation)]
        self._strangers = Strangers(rng, _LONGEST_RANDOM)
        self._foreign = self._taken = 0

    def throw(self) -> int:
        encoded = self._encoder.encode(next(self._observations))
        sound = encoded.full if self._rng.random() < 0.5 or encoded.compact is None else encoded.compact
        sound = self._others[int(self._rng.integers(len(self._others)))] if self._rng.random() < 0.2 else sound
        offered = 0
        for _ in range(_FOREIGN_TO_A_SOUND_ONE):
            data = self._strangers.next(sound)
            offered += len(data)
            self._foreign += 1
            self._decoder.decode(data)
        self._strangers.remember(sound)
        self._taken += self._decoder.decode(sound) is not None
        if self._decoder.wants_keyframe:
            self._encoder.reset()
        return offered + len(sound)

    def verdict(self) -> Verdict:
        """A keyframe brings both sides together again; another start of the robot is a newer one."""
        self._encoder.reset()
        again = [self._encoder.encode(replace(o, boot_id=100)) for o in drive(3, self._rng)]
        taken = [e.compact is not None and self._decoder.decode(e.compact) is not None for e in again]
        require(all(taken), "observations are not followed again after a keyframe")
        return Verdict(self._foreign, 0, self._taken, 0)
