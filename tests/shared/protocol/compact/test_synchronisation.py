from __future__ import annotations

import zlib
from collections import deque

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from shared.protocol.compact.decoder import Decoder
from shared.protocol.compact.encoder import NUMBERS, WINDOW, Encoder
from shared.protocol.compact.model import Coding, Model
from shared.protocol.compact.state import State, Unfit
from shared.protocol.compact.walk import code_observation
from tests.shared.protocol.compact.test_compact import assert_near
from tools.fuzz.room_drive import drive


def test_losses_neither_corrupt_nor_stop_what_follows(rng: np.random.Generator) -> None:
    encoder, decoder = Encoder(), Decoder()
    answers: deque[bytes] = deque()
    keyframes = 0
    for observation in drive(60, rng):
        encoded = encoder.encode(observation)
        keyframes += encoded.keyframe
        if rng.random() > 0.3:
            got = decoder.decode(encoded.datagram)
            assert got is not None
            assert_near(observation, got)
        answers.append(decoder.feedback())
        if len(answers) == 2 and rng.random() > 0.3:
            encoder.acknowledge(answers.popleft())
        elif len(answers) == 2:
            answers.popleft()
    assert decoder.counts.damaged == decoder.counts.without_base == 0
    assert keyframes <= 10


def test_an_observation_whose_base_was_lost_is_refused_and_a_keyframe_asked_for(rng: np.random.Generator) -> None:
    encoder, decoder = Encoder(in_order=True), Decoder()
    first, lost, third, fourth = drive(4, rng)
    assert decoder.decode(encoder.encode(first).datagram) is not None
    encoder.encode(lost)
    assert decoder.decode(encoder.encode(third).datagram) is None
    assert decoder.counts.without_base == 1
    encoder.acknowledge(decoder.feedback())
    encoded = encoder.encode(fourth)
    assert encoded.keyframe
    got = decoder.decode(encoded.datagram)
    assert got is not None
    assert_near(fourth, got)


def test_sides_that_came_to_differ_notice_and_begin_anew(rng: np.random.Generator) -> None:
    encoder, decoder = Encoder(in_order=True), Decoder()
    observations = drive(12, rng)
    for observation in observations[:4]:
        decoder.decode(encoder.encode(observation).datagram)
    decoder._states[decoder._newest].scans[0, 30, 0] += 3000  # type: ignore[index]
    accepted = []
    for observation in observations[4:]:
        accepted.append(decoder.decode(encoder.encode(observation).datagram))
        encoder.acknowledge(decoder.feedback())
    assert accepted[0] is None
    assert accepted[-1] is not None
    assert decoder.counts.keyframes == 2


def test_a_station_that_comes_later_gets_a_keyframe(rng: np.random.Generator) -> None:
    encoder = Encoder(in_order=True)
    for observation in drive(3, rng):
        encoder.encode(observation)
    late = Decoder()
    encoder.acknowledge(late.feedback())
    last = drive(4, rng)[3]
    got = late.decode(encoder.encode(last).datagram)
    assert got is not None
    assert_near(last, got)


def test_a_robot_that_began_anew_is_followed(rng: np.random.Generator) -> None:
    decoder = Decoder()
    observations = drive(3, rng)
    for observation in observations:
        decoder.decode(Encoder().encode(observation).datagram)
    again = observations[0]
    other = type(again)(**{name: getattr(again, name) for name in again.__slots__} | {"boot_id": 78})
    assert decoder.decode(Encoder().encode(other).datagram) is not None


def test_what_is_repeated_or_late_is_dropped(rng: np.random.Generator) -> None:
    encoder, decoder = Encoder(in_order=True), Decoder()
    datagrams = [encoder.encode(observation).datagram for observation in drive(30, rng)]
    assert all(decoder.decode(datagram) is not None for datagram in datagrams)
    digest = decoder.feedback()
    assert all(decoder.decode(datagram) is None for datagram in datagrams)
    assert decoder.counts.good == 30
    assert decoder.feedback()[1:] == digest[1:] or decoder.feedback()[0] & 0x10


def test_both_sides_keep_a_bounded_number_of_states(rng: np.random.Generator) -> None:
    encoder, decoder = Encoder(), Decoder()
    for observation in drive(2 * NUMBERS, rng):
        decoder.decode(encoder.encode(observation).datagram)
        if rng.random() < 0.2:
            encoder.acknowledge(decoder.feedback())
        assert len(encoder._sent) <= WINDOW
        assert len(decoder._states) <= WINDOW


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=200))
def test_foreign_bytes_are_dropped_and_change_nothing(data: bytes) -> None:
    decoder = DECODER
    before = decoder.counts.good, decoder._newest
    assert decoder.decode(data) is None
    assert (decoder.counts.good, decoder._newest) == before


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 29), st.lists(st.tuples(st.integers(0, 400), st.integers(1, 255)), min_size=1, max_size=4))
def test_a_datagram_with_any_bytes_changed_is_never_believed(index: int, changes: list[tuple[int, int]]) -> None:
    decoder = _after(index)
    damaged = bytearray(DATAGRAMS[index])
    for at, difference in changes:
        damaged[at % len(damaged)] ^= difference
    if bytes(damaged) != DATAGRAMS[index]:
        assert decoder.decode(bytes(damaged)) is None


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 29), st.integers(0, 400))
def test_a_datagram_that_is_cut_is_never_believed(index: int, length: int) -> None:
    whole = DATAGRAMS[index]
    assert _after(index).decode(whole[: length % len(whole)]) is None


@settings(max_examples=80, deadline=None)
@given(st.binary(max_size=4))
def test_foreign_answers_do_no_harm(data: bytes) -> None:
    encoder = Encoder()
    first, second = drive(2, np.random.default_rng(5))
    encoder.encode(first)
    encoder.acknowledge(data)
    encoder.encode(second)


def test_states_are_the_same_on_every_machine() -> None:
    """Whatever is read, from bytes that no float had a part in, leads to the state that was written down here."""
    noise = 12345
    digest = 0
    for _ in range(20):
        data = bytearray()
        for _ in range(120):
            noise = (noise * 1103515245 + 12345) & 0x7FFFFFFF
            data.append(noise >> 16 & 0xFF)
        state = STATE.copy()
        state.model = Model.untrained()
        payload = np.frombuffer(bytes(data), np.uint8).copy()
        try:
            code_observation(Coding(state.model, payload, len(payload), reading=True), state, None)
            digest = zlib.crc32(state.digest.to_bytes(4, "little"), digest)
        except Unfit:
            digest = zlib.crc32(b"unfit", digest)
    assert digest == GOLDEN


def _sent() -> list[bytes]:
    encoder = Encoder(in_order=True)
    return [encoder.encode(observation).datagram for observation in drive(30, np.random.default_rng(3))]


def _after(index: int) -> Decoder:
    """A decoder that has everything before the datagram of this index."""
    decoder = Decoder()
    decoder._states = dict(STATES[index][0])  # type: ignore[assignment]
    decoder._newest = STATES[index][1]
    return decoder


def _states() -> tuple[Decoder, list[tuple[dict[int, State], int | None]]]:
    decoder, states = Decoder(), []
    for datagram in DATAGRAMS:
        states.append((dict(decoder._states), decoder._newest))
        decoder.decode(datagram)
    return decoder, states


def _blank() -> State:
    state = State(Model.untrained())
    sending = drive(1, np.random.default_rng(1))[0]
    state.geometry = sending.geometry
    beams = len(sending.ranges_m)
    state.scans = np.zeros((4, beams, 4), np.int64)
    state.before_mm = np.zeros(beams, np.int64)
    return state


DATAGRAMS = _sent()
DECODER, STATES = _states()
STATE = _blank()
GOLDEN = 1487023033
