from __future__ import annotations

import numpy as np
import pytest

from shared.protocol.auth import GREETING_PACKET_BYTES, Answerer, Caller, Kind, SealKey, head_of, read_head

KEY = SealKey(bytes(range(32)), bytes(range(32, 64)), 4)
RNG = np.random.default_rng(5)


def greeted(robot_key: bytes = bytes(32), station_key: bytes = bytes(32)) -> tuple[Caller, Answerer]:
    return Caller(robot_key, RNG.bytes), Answerer(station_key, RNG.bytes)


@pytest.mark.parametrize("body", [b"", b"x", bytes(range(45))])
def test_what_was_sealed_can_be_opened_and_cannot_be_read(body: bytes) -> None:
    packet = KEY.seal(head_of(Kind.DATA, False, 7), 7, body)
    assert KEY.open(packet, 7) == body
    assert len(packet) == len(body) + KEY.overhead_bytes
    assert len(body) < 8 or body not in packet


def test_a_changed_bit_anywhere_is_refused() -> None:
    packet = KEY.seal(head_of(Kind.DATA, True, 7), 7, b"drive on")
    for bit in range(8 * len(packet)):
        forged = bytearray(packet)
        forged[bit // 8] ^= 1 << bit % 8
        assert KEY.open(bytes(forged), 7) is None


def test_another_counter_or_key_is_refused() -> None:
    packet = KEY.seal(head_of(Kind.DATA, False, 7), 7, b"drive on")
    assert KEY.open(packet, 39) is None
    assert SealKey(bytes(32), KEY.cipher, 4).open(packet, 7) is None


@pytest.mark.parametrize("length", [*range(6), 70, 300])
def test_a_packet_that_no_body_gives_is_refused(length: int) -> None:
    assert KEY.open(bytes(length), 0) is None


def test_a_head_says_what_it_was_made_of() -> None:
    for kind in Kind:
        assert read_head(head_of(kind, True, 37)[0]) == (kind, True, 5)


def test_a_greeting_gives_both_sides_the_same_keys() -> None:
    caller, answerer = greeted()
    answered = answerer.hear(caller.call())
    assert answered is not None
    answer, station = answered
    robot = caller.hear(answer)
    assert robot is not None
    assert (robot.outgoing, robot.incoming) == (station.incoming, station.outgoing)
    assert robot.outgoing != robot.incoming
    assert len(answer) == GREETING_PACKET_BYTES


def test_another_key_is_not_answered_and_its_answer_is_not_believed() -> None:
    caller, stranger = greeted(station_key=b"\1" * 32)
    assert stranger.hear(caller.call()) is None
    friend = Answerer(bytes(32), RNG.bytes)
    answered = friend.hear(caller.call())
    assert answered is not None
    forged = answered[0][:-1] + bytes((answered[0][-1] ^ 1,))
    assert caller.hear(forged) is None


def test_an_answer_played_again_makes_no_session() -> None:
    caller, answerer = greeted()
    answered = answerer.hear(caller.call())
    assert answered is not None
    assert caller.hear(answered[0]) is not None
    caller.call()
    assert caller.hear(answered[0]) is None


def test_each_greeting_has_keys_of_its_own() -> None:
    caller, answerer = greeted()
    sessions = []
    for _ in range(3):
        answered = answerer.hear(caller.call())
        assert answered is not None
        sessions.append(caller.hear(answered[0]))
    assert len({s.outgoing.mac for s in sessions if s is not None}) == 3
