"""The parser of a module in operation, on good bytes in any portions and on millions of bad ones."""

from __future__ import annotations

import math
import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shared.link.es920lr.parser import (
    HALF_FRAME_S,
    MODE_QUESTION,
    AsksForMode,
    Heard,
    OperationParser,
    Reply,
    Started,
    Utterance,
)

FUZZED_BYTES = int(os.environ.get("FUZZED_BYTES", "2000000"))
_MOST_HELD = 63


def packet(payload: bytes, rssi: bytes = b"FFC4", pan: bytes = b"0001", sender: bytes = b"0002") -> bytes:
    text = rssi + pan + sender + payload
    return bytes((len(text),)) + text


SAMPLES: list[tuple[bytes, Utterance]] = [
    (b"\x02OK", Reply(None)),
    (b"\x06NG 102", Reply(102)),
    (packet(b"x"), Heard(b"x", -60, 1, 2)),
    (packet(bytes(range(50))), Heard(bytes(range(50)), -60, 1, 2)),
    (packet(b"\x02OK\r\n"), Heard(b"\x02OK\r\n", -60, 1, 2)),
    (b"\r\n" + MODE_QUESTION, AsksForMode()),
]


@given(st.lists(st.sampled_from(SAMPLES), max_size=12), st.lists(st.integers(1, 40)))
def test_any_portions_give_the_same(spoken: list[tuple[bytes, Utterance]], portions: list[int]) -> None:
    data, parser, heard = b"".join(text for text, _ in spoken), OperationParser(), []
    for portion in (*portions, len(data) + 1):
        heard += parser.feed(data[:portion], 0.0)
        data = data[portion:]
    assert heard == [utterance for _, utterance in spoken]
    assert parser.dropped_bytes == 0


def test_a_restart_into_configuration_begins_with_an_empty_line() -> None:
    parser = OperationParser()
    assert parser.feed(b"\xfc\xfc\r\n", 0.0) == []
    assert parser.feed(MODE_QUESTION, 0.05) == [AsksForMode()]
    assert parser.dropped_bytes == 2


def test_a_start_is_an_empty_line_and_nothing_after_it() -> None:
    parser = OperationParser()
    assert parser.feed(b"\xfc\r\n", 0.0) == []
    assert parser.deadline_s == pytest.approx(0.1)
    assert parser.expire(0.05) == []
    assert parser.expire(0.1) == [Started()]
    assert parser.deadline_s == math.inf
    assert parser.feed(b"\r\n\x02OK", 1.0) == [Started(), Reply(None)]


def test_every_length_that_begins_a_packet_is_one() -> None:
    parser = OperationParser()
    for length in range(1, 51):
        assert parser.feed(packet(bytes(length)), 0.0) == [Heard(bytes(length), -60, 1, 2)]


@pytest.mark.parametrize(("text", "rssi_dbm"), [(b"FFC4", -60), (b"-060", -60), (b" -60", -60), (b"0005", 5)])
def test_strength_is_read_as_hex_or_as_a_number(text: bytes, rssi_dbm: int) -> None:
    assert OperationParser().feed(packet(b"x", rssi=text), 0.0) == [Heard(b"x", rssi_dbm, 1, 2)]


@pytest.mark.parametrize("rssi", [b"7FFF", b"0060", b"-999", b"- 60", b"+-+-"])
def test_a_strength_that_no_radio_hears_is_noise(rssi: bytes) -> None:
    parser = OperationParser()
    assert Reply(None) in parser.feed(packet(b"xyz", rssi=rssi) + b"\x02OK", 0.0)
    assert parser.dropped_bytes > 0


def test_noise_is_dropped_and_what_follows_is_heard() -> None:
    for noise in (
        b"\xff\xfc\xe0",
        b"\x02KO",
        b"\x06NG x",
        b"\x0d\x0d",
        b"\x20short",
        b"Select Mud",
        b"\x02O",
        b"\x06NG 12a",
    ):
        parser = OperationParser()
        assert parser.feed(noise + packet(b"after"), 0.0) == [Heard(b"after", -60, 1, 2)]
        assert parser.dropped_bytes == len(noise)


def test_half_a_packet_is_given_up_after_half_a_second_and_its_rest_is_looked_through() -> None:
    parser = OperationParser()
    cut = packet(bytes(50))[:20]
    assert parser.feed(cut + b"\x02OK", 0.0) == []
    assert parser.expire(HALF_FRAME_S / 2) == []
    assert parser.expire(HALF_FRAME_S) == [Reply(None)]
    assert parser.dropped_bytes == len(cut)
    assert parser.feed(packet(b"next"), 10.0) == [Heard(b"next", -60, 1, 2)]


def test_slow_bytes_are_no_half_packet() -> None:
    parser, heard = OperationParser(), []
    for i, byte in enumerate(packet(b"slow")):
        heard += parser.feed(bytes((byte,)), i * 0.4)
    assert heard == [Heard(b"slow", -60, 1, 2)]


def _mutated(rng: np.random.Generator, size: int) -> bytes:
    """Good speech with bytes changed, cut out, repeated and put in."""
    chosen = rng.integers(0, len(SAMPLES), size // 20)
    data = bytearray(b"".join(SAMPLES[i][0] for i in chosen)[:size])
    for at in rng.integers(0, len(data), size // 50):
        data[at] = rng.integers(0, 256)
    for at in rng.integers(0, len(data) - 80, size // 200):
        del data[at : at + int(rng.integers(1, 60))]
        data[at:at] = data[at + 5 : at + 5 + int(rng.integers(1, 20))]
    return bytes(data)


def test_any_bytes_at_all_are_taken_without_harm(rng: np.random.Generator) -> None:
    """Two million here; with FUZZED_BYTES=10000000 in the environment as many as that."""
    parser, taken, now_s, heard = OperationParser(), 0, 0.0, 0
    while taken < FUZZED_BYTES:
        size = 20_000
        data = rng.bytes(size) if rng.random() < 0.5 else _mutated(rng, size)
        at = 0
        while at < len(data):
            portion = int(rng.integers(1, 2_000))
            for utterance in parser.feed(data[at : at + portion], now_s):
                heard += isinstance(utterance, Heard)
                if isinstance(utterance, Heard):
                    assert 1 <= len(utterance.payload) <= 50
                    assert -200 <= utterance.rssi_dbm <= 50
            assert len(parser._buffer) <= _MOST_HELD
            at += portion
            now_s += float(rng.choice((0.0, 0.01, 1.0)))
        taken += len(data)
        parser.expire(now_s + 1.0)
        now_s += 1.0
        assert parser._buffer == b""
    assert heard > 0
    assert parser.feed(packet(b"still here"), now_s) == [Heard(b"still here", -60, 1, 2)]
