"""The language alone, on what real scanners sent."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from robot_app.drivers.scip import (
    ReplyBuffer,
    ScanDecoder,
    checksum,
    decode_number,
    parse_reply,
    status_name,
)
from tools.simulator.devices.scip_sensor import encode, read_session, scan_reply

BEAMS = 682


def plain_values(body: bytes, characters: int) -> list[int]:
    """The twin of the decoder, character by character."""
    text = b"".join(line[:-1] for line in body.split(b"\n")[1:])
    return [decode_number(text[i : i + characters]) or 0 for i in range(0, len(text), characters)]


@pytest.mark.parametrize("name", ["example_urg_04lx", "example_utm_30lx", "example_uxm_30lx_e"])
def test_every_captured_reply_is_understood(scip_data: Path, name: str) -> None:
    session = read_session(scip_data, name)
    assert len(session) >= 10
    for exchange in session:
        block = exchange.reply.split(b"\n\n")[0]
        reply = parse_reply(block, exchange.request)
        assert reply is not None
        assert reply.echo == exchange.request
        if exchange.request[:2] not in {b"ME", b"MD", b"MS"}:
            assert reply.text + b"\n\n" == exchange.reply


@pytest.mark.parametrize(
    ("name", "request_text", "beams", "valid"),
    [("example_urg_04lx", b"GD0044072501", 682, 581), ("example_uxm_30lx_e", b"GD0000076001", 761, None)],
)
def test_captured_scans_are_decoded(
    scip_data: Path, name: str, request_text: bytes, beams: int, valid: int | None
) -> None:
    (exchange,) = (e for e in read_session(scip_data, name) if e.request == request_text)
    reply = parse_reply(exchange.reply[:-2], request_text)
    assert reply is not None
    scan = ScanDecoder(beams, 3).decode(reply.body)
    assert scan is not None
    assert scan.values.tolist() == plain_values(reply.body, 3)
    if valid is not None:
        assert int((scan.values >= 20).sum()) == valid


def test_the_other_units_reply_is_decoded(scip_data: Path) -> None:
    data = (scip_data / "urg_04lx_ug01_GD0044072501_reply.bin").read_bytes()
    reply = parse_reply(data[:-2], b"GD0044072501")
    assert reply is not None
    scan = ScanDecoder(BEAMS, 3).decode(reply.body)
    assert scan is not None
    assert int((scan.values >= 20).sum()) == 597


@pytest.mark.parametrize("characters", [2, 3])
@given(values=st.lists(st.integers(0, 4095), min_size=1, max_size=200))
def test_what_is_encoded_is_decoded(values: list[int], characters: int) -> None:
    block = scan_reply(b"MS0044072501000", 0x123456, np.array(values), characters)[:-2]
    reply = parse_reply(block, b"MS00440725010")
    assert reply is not None
    scan = ScanDecoder(len(values), characters).decode(reply.body)
    assert scan is not None
    assert scan.values.tolist() == values
    assert scan.time_ms == 0x123456


def test_a_scan_of_ms_has_the_length_of_the_specification(values_mm: NDArray[np.int_]) -> None:
    data = scan_reply(b"MS0044072501000", 0, values_mm)
    assert len(data) == 1435 == ScanDecoder(BEAMS, 2).reply_bytes
    assert len(scan_reply(b"MD0044072501000", 0, values_mm, 3)) == 2137


def test_no_changed_character_goes_unnoticed(values_mm: NDArray[np.int_]) -> None:
    """A sum of six bits sees every change of one character that is a legal one."""
    reply = parse_reply(scan_reply(b"MS0044072501000", 0, values_mm)[:-2], b"MS00440725010")
    assert reply is not None
    decoder = ScanDecoder(BEAMS, 2)
    for at in range(len(reply.body)):
        changed = bytearray(reply.body)
        changed[at] ^= 0x01
        assert decoder.decode(bytes(changed)) is None


@given(st.binary(max_size=300))
def test_foreign_bytes_never_raise(data: bytes) -> None:
    buffer = ReplyBuffer()
    buffer.feed(data + b"\n\n")
    decoder = ScanDecoder(8, 2)
    for block in buffer.take():
        parse_reply(block, b"MS")
        decoder.decode(block)


@given(
    spots=st.lists(st.tuples(st.integers(0, 900), st.integers(0, 40), st.binary(max_size=6)), min_size=1, max_size=8)
)
def test_a_mangled_stream_gives_scans_or_nothing(spots: list[tuple[int, int, bytes]]) -> None:
    stream = b"".join(scan_reply(b"MS0000000701000", i, np.full(8, 100 + i)) for i in range(20))
    for at, length, inserted in spots:
        stream = stream[:at] + inserted + stream[at + length :]
    buffer, decoder = ReplyBuffer(), ScanDecoder(8, 2)
    buffer.feed(stream)
    for block in buffer.take():
        reply = parse_reply(block, b"MS00000007010")
        scan = decoder.decode(reply.body) if reply is not None else None
        assert scan is None or scan.values.shape == (8,)


@given(cuts=st.lists(st.integers(1, 200), max_size=40))
def test_any_chunking_gives_the_same_replies(cuts: list[int]) -> None:
    stream = b"".join(scan_reply(b"MS0000000701000", i, np.full(8, 100 + i)) for i in range(20))
    buffer, blocks, at = ReplyBuffer(), [], 0
    for cut in [*cuts, len(stream)]:
        buffer.feed(stream[at : at + cut])
        blocks += buffer.take()
        at += cut
    assert b"".join(block + b"\n\n" for block in blocks) == stream


def test_the_buffer_is_bounded() -> None:
    buffer = ReplyBuffer()
    for _ in range(100):
        buffer.feed(b"x" * 16_384)
    assert buffer.discarded_bytes > 1_500_000
    good = scan_reply(b"MS0000000701000", 5, np.full(8, 100))
    buffer.feed(b"\n\n" + good)
    assert buffer.take()[-1] + b"\n\n" == good


def test_a_reply_behind_garbage_is_found() -> None:
    block = b"\xff\x00ut" + scan_reply(b"MS0000000701000", 5, np.full(8, 100))[:-2]
    reply = parse_reply(block, b"MS00000007010")
    assert reply is not None
    assert ScanDecoder(8, 2).decode(reply.body) is not None


@pytest.mark.parametrize(
    ("command", "status", "words"),
    [
        ("MS", b"99", "sends a scan"),
        ("MS", b"02", "parameter"),
        ("MS", b"33", "check an error"),
        ("MS", b"55", "hardware"),
        ("BM", b"01", "faulty"),
        ("VV", b"0E", "does not know"),
        ("VV", b"\xffx", "unknown"),
    ],
)
def test_every_status_has_a_name(command: str, status: bytes, words: str) -> None:
    assert words in status_name(command, status)


def test_numbers_and_sums() -> None:
    assert decode_number(b"CB") == 0x13 << 6 | 0x12
    assert decode_number(encode(0xABCDEF, 4)) == 0xABCDEF
    assert decode_number(b"\x00\x00") is None
    assert checksum(b"00") == ord("P")
    assert checksum(b"99") == ord("b")
