"""Who may speak: keys, sealed packets and the greeting that makes a session key.

A sealed packet is its head (1 byte, readable), its body encrypted, and a tag. The tag is a keyed BLAKE2s over head,
body and a 64-bit counter of which only the lowest bits travel; the body is encrypted with a stream that begins with
the tag (the construction of SIV, RFC 5297). So a packet that was changed anywhere becomes another random one, nobody
chooses what a lucky guess would say, and a counter used twice gives nothing away.

What a tag costs and buys. A forger has one guess a packet, and the air lets him have 65 a second on a channel (the
shortest packet at SF7 and 500 kHz). To the station a tag has 4 bytes: with the 6 counters that fit to a head that is
one accepted packet of random content in 2^32 / 6 / 65 s = 127 days of uninterrupted shouting, and the datagram in it
still has its own CRC. To the robot, which moves, a tag has 8 bytes: 10^9 years. Those packets are few.
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

KEY_BYTES = 32
VERSION = 1
BOOT_BYTES = 4
TAG_TO_STATION_BYTES = 4
TAG_TO_ROBOT_BYTES = 8
_NONCE_BYTES = 8
_GREETING_TAG_BYTES = 8
_GREETING_BYTES = 1 + BOOT_BYTES + _NONCE_BYTES
GREETING_PACKET_BYTES = 1 + _GREETING_BYTES + _GREETING_TAG_BYTES
_MOST_BODY_BYTES = 64  # what one BLAKE2b gives

RandomBytes = Callable[[int], bytes]


class Kind(IntEnum):
    """What a packet is; the two highest bits of its head."""

    DATA = 0
    ITEMS = 1
    CALL = 2
    ANSWER = 3


LOW_BITS = 5


def head_of(kind: Kind, turn: bool, counter: int) -> bytes:
    """The first byte: kind, "it is your turn", and the lowest bits of the counter."""
    return bytes((kind << 6 | turn << LOW_BITS | counter & (1 << LOW_BITS) - 1,))


def read_head(head: int) -> tuple[Kind, bool, int]:
    return Kind(head >> 6), bool(head >> LOW_BITS & 1), head & (1 << LOW_BITS) - 1


@dataclass(frozen=True, slots=True)
class SealKey:
    """Of one direction of one session."""

    mac: bytes
    cipher: bytes
    tag_bytes: int

    @property
    def overhead_bytes(self) -> int:
        return 1 + self.tag_bytes

    def seal(self, head: bytes, counter: int, body: bytes) -> bytes:
        tag = self._tag(head, counter, body)
        return head + self._crypt(tag, counter, body) + tag

    def open(self, packet: bytes, counter: int) -> bytes | None:
        """The body, or None when this is not what `seal` made with this counter."""
        if not 0 <= len(packet) - self.overhead_bytes <= _MOST_BODY_BYTES:
            return None
        head, tag = packet[:1], packet[-self.tag_bytes :]
        body = self._crypt(tag, counter, packet[1 : -self.tag_bytes])
        return body if hmac.compare_digest(tag, self._tag(head, counter, body)) else None

    def _tag(self, head: bytes, counter: int, body: bytes) -> bytes:
        salt = counter.to_bytes(8, "little")
        return hashlib.blake2s(head + body, key=self.mac, salt=salt, digest_size=self.tag_bytes).digest()

    def _crypt(self, tag: bytes, counter: int, body: bytes) -> bytes:
        if not 0 <= len(body) <= _MOST_BODY_BYTES:
            raise ValueError(f"a body of {len(body)} bytes")
        salt = counter.to_bytes(16, "little")
        stream = hashlib.blake2b(tag, key=self.cipher, salt=salt, digest_size=_MOST_BODY_BYTES).digest()
        mixed = int.from_bytes(body, "little") ^ int.from_bytes(stream[: len(body)], "little")
        return mixed.to_bytes(len(body), "little")


@dataclass(frozen=True, slots=True)
class Session:
    """What a greeting has made. `peer_boot` is another one after the other side began anew."""

    outgoing: SealKey
    incoming: SealKey
    peer_boot: bytes


def _derive(key: bytes, purpose: bytes, transcript: bytes = b"") -> bytes:
    return hashlib.blake2s(transcript, key=key, person=purpose).digest()


def _session(key: bytes, call: bytes, answer: bytes, is_robot: bool) -> Session:
    master = _derive(key, b"session", call + answer)
    to_station = SealKey(_derive(master, b"mac st"), _derive(master, b"enc st"), TAG_TO_STATION_BYTES)
    to_robot = SealKey(_derive(master, b"mac rb"), _derive(master, b"enc rb"), TAG_TO_ROBOT_BYTES)
    peer = answer if is_robot else call
    boot = peer[1 : 1 + BOOT_BYTES]
    return Session(to_station, to_robot, boot) if is_robot else Session(to_robot, to_station, boot)


def _greeting_tag(key: bytes, purpose: bytes, data: bytes) -> bytes:
    return hashlib.blake2s(data, key=_derive(key, purpose), digest_size=_GREETING_TAG_BYTES).digest()


def _body(packet: bytes, kind: Kind) -> bytes | None:
    if len(packet) != GREETING_PACKET_BYTES or read_head(packet[0])[0] is not kind or packet[1] != VERSION:
        return None
    return packet[1 : 1 + _GREETING_BYTES]


class Caller:
    """The robot's side of the greeting: it calls, with a number that nobody has used, until somebody answers that."""

    def __init__(self, key: bytes, random_bytes: RandomBytes) -> None:
        self._key = key
        self._boot = random_bytes(BOOT_BYTES)
        self._random_bytes = random_bytes
        self._body: bytes | None = None

    def begin_anew(self) -> None:
        """Be another one from now on: the other side forgets what was on its way."""
        self._boot, self._body = self._random_bytes(BOOT_BYTES), None

    def call(self) -> bytes:
        """A packet for the air; the same one until it is answered."""
        if self._body is None:
            self._body = bytes((VERSION,)) + self._boot + self._random_bytes(_NONCE_BYTES)
        packet = head_of(Kind.CALL, True, 0) + self._body
        return packet + _greeting_tag(self._key, b"call", packet)

    def hear(self, packet: bytes) -> Session | None:
        """The session, when `packet` answers the call."""
        body, call = _body(packet, Kind.ANSWER), self._body
        if body is None or call is None:
            return None
        tag = _greeting_tag(self._key, b"answer", call + packet[: 1 + _GREETING_BYTES])
        if not hmac.compare_digest(tag, packet[-_GREETING_TAG_BYTES:]):
            return None
        self._body = None
        return _session(self._key, call, body, is_robot=True)


class Answerer:
    """The station's side. An old call played again gets an answer that is of no use to whoever played it."""

    def __init__(self, key: bytes, random_bytes: RandomBytes) -> None:
        self._key = key
        self._boot = random_bytes(BOOT_BYTES)
        self._random_bytes = random_bytes
        self._last: tuple[bytes, bytes, Session] | None = None

    def begin_anew(self) -> None:
        """Be another one from now on: the other side forgets what was on its way."""
        self._boot, self._last = self._random_bytes(BOOT_BYTES), None

    def hear(self, packet: bytes) -> tuple[bytes, Session] | None:
        """The answer for the air, and the session if the robot goes on to use it."""
        call = _body(packet, Kind.CALL)
        if call is None:
            return None
        tag = _greeting_tag(self._key, b"call", packet[: 1 + _GREETING_BYTES])
        if not hmac.compare_digest(tag, packet[-_GREETING_TAG_BYTES:]):
            return None
        if self._last is None or self._last[0] != call:
            body = bytes((VERSION,)) + self._boot + self._random_bytes(_NONCE_BYTES)
            self._last = call, body, _session(self._key, call, body, is_robot=False)
        _, body, session = self._last
        answer = head_of(Kind.ANSWER, True, 0) + body
        return answer + _greeting_tag(self._key, b"answer", call + answer), session
