from __future__ import annotations

import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shared.protocol import ascii as text
from shared.protocol import codec, wire
from tests.shared import samples

MESSAGES = samples.every_message(np.random.default_rng(1))


@pytest.mark.parametrize("index", range(len(MESSAGES)))
def test_every_message_comes_back_as_the_binary_profile_gives_it_back(index: int) -> None:
    binary = codec.Decoder().decode(codec.encode(MESSAGES[index]))
    decoder = text.Decoder()
    decoded = decoder.decode(text.encode(MESSAGES[index]))
    assert decoder.counts.good == 1
    assert decoded is not None
    assert binary is not None
    assert codec.encode(decoded) == codec.encode(binary)


def test_an_observation_is_readable_line_by_line() -> None:
    lines = text.encode(MESSAGES[0]).decode("ascii").splitlines()
    assert lines[0].startswith(f"observation {wire.VERSION} ")
    assert "sequence 7" in lines
    assert "odom_from_robot 1 -2 0.5" in lines
    assert "has_objects yes" in lines
    ranges = next(line for line in lines if line.startswith("ranges_m ")).split(" ")[1:]
    assert len(ranges) == 227
    assert all(word == "-" or word.isdigit() for word in ranges)


def test_any_change_of_a_byte_is_noticed() -> None:
    whole = text.encode(MESSAGES[2])
    decoder = text.Decoder()
    for at in range(len(whole)):
        assert decoder.decode(whole[:at] + bytes((whole[at] ^ 1,)) + whole[at + 1 :]) is None
        assert decoder.decode(whole[:at]) is None


@settings(max_examples=300)
@given(st.sampled_from(MESSAGES), st.data())
def test_lines_with_any_content_and_a_right_check_never_raise(message: object, data: st.DataObject) -> None:
    name, version, _ = text.encode(message).split(b"\n")[0].split(b" ")  # type: ignore[arg-type]
    lines = text.encode(message).split(b"\n")[1:-1]  # type: ignore[arg-type]
    at = data.draw(st.integers(0, max(0, len(lines) - 1)))
    foreign = data.draw(st.text('0123456789-,. eE[]"naif', max_size=40)).encode()
    if lines:
        lines[at] = lines[at].split(b" ")[0] + b" " + foreign
    body = b"".join(line + b"\n" for line in lines)
    head = b" ".join((name, version, f"{zlib.crc32(body):08x}".encode())) + b"\n"
    text.Decoder().decode(head + body)


@given(st.binary(max_size=200))
def test_foreign_bytes_never_raise(data: bytes) -> None:
    assert text.Decoder().decode(data) is None
