"""Frames of the transceiver's USB protocol."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shared.protocol import transceiver as t
from shared.protocol.crc16 import crc16
from shared.protocol.transceiver_frame import FrameReader, encode, stuff, unstuff

FRAMES = [
    t.Announce(t.FINGERPRINT, 1, 0, 3, 7),
    t.Hello(0, 1 << 31),
    t.Goodbye(),
    t.Data(1, 0, bytes(64)),
    t.Data(0, 65_535, b"\xff" * 64),
    t.Acknowledge(1, 256, 0),
    t.SetBaud(255, 0, 115_200),
    t.Health(1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12),
]


def test_the_check_sum_is_the_published_one() -> None:
    assert crc16(b"123456789") == 0x6F91
    assert crc16(b"123456789" + (0x6F91).to_bytes(2, "little")) == 0


@given(st.binary(max_size=253))
def test_stuffing_leaves_no_zero_and_can_be_undone(content: bytes) -> None:
    stuffed = stuff(content)
    assert 0 not in stuffed
    assert len(stuffed) == len(content) + 1
    assert unstuff(stuffed) == content


@given(st.binary(max_size=80))
def test_unstuffing_never_raises(stuffed: bytes) -> None:
    content = unstuff(stuffed.replace(b"\0", b"\1"))
    assert content is None or len(content) < max(1, len(stuffed))


@pytest.mark.parametrize("portion", [1, 3, 1_000])
def test_frames_come_back_in_any_portions(portion: int) -> None:
    wire = b"".join(map(encode, FRAMES))
    reader = FrameReader()
    heard = [f for at in range(0, len(wire), portion) for f in reader.feed(wire[at : at + portion])]
    assert heard == FRAMES
    assert (reader.frames, reader.bad_frames) == (len(FRAMES), 0)


def test_one_wrong_bit_anywhere_is_noticed() -> None:
    wire = encode(t.Data(1, 513, b"a radio packet"))
    for bit in range(8 * (len(wire) - 1)):
        spoilt = bytearray(wire)
        spoilt[bit // 8] ^= 1 << bit % 8
        reader = FrameReader()
        assert reader.feed(bytes(spoilt)) == []
        assert reader.bad_frames >= 1


def test_after_garbage_the_next_frame_but_one_is_read(rng: np.random.Generator) -> None:
    reader = FrameReader()
    for _ in range(100):
        reader.feed(rng.bytes(int(rng.integers(1, 200))))
        reader.feed(encode(t.Goodbye()))
        assert reader.feed(encode(t.Ping(1))) == [t.Ping(1)]


def test_an_endless_frame_is_not_kept() -> None:
    reader = FrameReader()
    for _ in range(100):
        assert reader.feed(b"\xff" * 1_000) == []
    assert len(reader._buffer) <= 100
    assert reader.feed(b"\0" + encode(t.Ping(0))) == [t.Ping(0)]
    assert reader.bad_frames == 1


def test_a_sound_check_sum_does_not_make_a_frame_of_a_wrong_size() -> None:
    for content in (b"\x20", b"\x20\x01\x02", b"\x10\x00\x00\x00", b"\x99abc", b"\x10" + bytes(3 + 65)):
        wire = stuff(content + crc16(content).to_bytes(2, "little")) + b"\0"
        assert FrameReader().feed(wire) == []


def test_what_fits_in_no_frame_is_refused() -> None:
    with pytest.raises(ValueError, match="65 bytes"):
        encode(t.Data(0, 0, bytes(65)))
    with pytest.raises(struct.error):
        encode(t.Ping(256))


def test_the_host_never_has_more_on_usb_than_the_ring_of_the_firmware_holds() -> None:
    frames_per_window = -(-t.WINDOW_BYTES // t.MAX_DATA_BYTES)
    overhead = len(encode(t.Data(0, 0, b"x"))) - 1
    at_worst = t.RADIOS * (t.WINDOW_BYTES + frames_per_window * overhead) + t.RADIOS * len(
        encode(t.Acknowledge(0, 0, 0))
    )
    assert at_worst + len(encode(t.Ping(1))) <= 255
