from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from shared.protocol.frame import HEAD_BYTES, MAX_PAYLOAD_BYTES, FrameParser, pack

datagrams = st.lists(st.binary(min_size=1, max_size=300), max_size=8)


@given(datagrams, st.integers(1, 50))
def test_datagrams_survive_any_chunking(sent: list[bytes], chunk: int) -> None:
    stream = b"".join(map(pack, sent))
    parser = FrameParser()
    received = [d for i in range(0, len(stream), chunk) for d in parser.feed(stream[i : i + chunk])]
    assert received == sent
    assert parser.dropped_bytes == 0


@given(st.binary(max_size=500), st.binary(min_size=1, max_size=50))
def test_the_parser_finds_the_next_frame_after_garbage(garbage: bytes, datagram: bytes) -> None:
    parser = FrameParser()
    parser.feed(garbage)
    frame = pack(datagram)
    received: list[bytes] = []
    # Garbage may look like a head that announces up to 65 000 bytes; after those the parser must be in step again.
    for _ in range((MAX_PAYLOAD_BYTES + 500) // len(frame) + 3):
        received += parser.feed(frame)
    assert received[-1] == datagram


@given(st.binary(max_size=2000))
def test_random_bytes_never_raise_and_never_grow_the_buffer_beyond_a_frame(data: bytes) -> None:
    parser = FrameParser()
    parser.feed(data)
    assert len(parser._buffer) <= MAX_PAYLOAD_BYTES + HEAD_BYTES


@pytest.mark.parametrize("size", [0, MAX_PAYLOAD_BYTES + 1])
def test_a_datagram_that_fits_no_frame_is_refused(size: int) -> None:
    with pytest.raises(ValueError, match=str(size)):
        pack(bytes(size))
