from __future__ import annotations

import numpy as np
import pytest

from shared.protocol.fragment import Assembler, Cutter, StreamError, length_prefix


def test_datagrams_survive_any_cutting() -> None:
    rng = np.random.default_rng(1)
    cutter, assembler = Cutter(), Assembler(70_000)
    sent = [rng.bytes(int(n)) for n in (1, 2, 45, 127, 128, 129, 16_383, 16_384, 65_000, 3)]
    for datagram in sent:
        cutter.add(datagram)
    came: list[bytes] = []
    while cutter.waiting_bytes:
        came += assembler.feed(cutter.cut(int(rng.integers(1, 60))))
    assert came == sent
    assert cutter.cut(50) == b""


def test_small_datagrams_share_a_segment() -> None:
    cutter = Cutter()
    for i in range(5):
        cutter.add(bytes((i,)) * 4)
    assert Assembler(100).feed(cutter.cut(45)) == [bytes((i,)) * 4 for i in range(5)]


@pytest.mark.parametrize("stream", [b"\x00", length_prefix(101), b"\xff\xff\xff\xff"])
def test_a_length_that_no_datagram_has_is_an_error(stream: bytes) -> None:
    with pytest.raises(StreamError):
        Assembler(100).feed(stream + bytes(100))
