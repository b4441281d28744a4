from __future__ import annotations

import dataclasses
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shared.messages import GoTo, NumberedCommand, Observation, Telemetry
from shared.protocol import wire
from shared.protocol.codec import Decoder, encode
from tests.shared import samples


def flat(value: object) -> list[object]:
    """A message's numbers and texts, arrays included, for comparison."""
    if dataclasses.is_dataclass(value):
        return [x for f in dataclasses.fields(value) for x in flat(getattr(value, f.name))]
    if isinstance(value, tuple | list | np.ndarray):
        return [x for item in list(value) for x in flat(item)]
    return [value]


@pytest.mark.parametrize("index", range(14))
def test_every_message_comes_back_as_it_was_sent(index: int, rng: np.random.Generator) -> None:
    message = samples.every_message(rng)[index]
    decoded = Decoder().decode(encode(message))
    assert type(decoded) is type(message)
    for sent, received in zip(flat(message), flat(decoded), strict=True):
        if isinstance(sent, float | np.floating):
            assert received == pytest.approx(sent, abs=0.0051, nan_ok=True)
        else:
            assert received == sent


def test_the_sample_covers_every_type_of_the_table(rng: np.random.Generator) -> None:
    seen = {encode(m)[1] for m in samples.every_message(rng)}
    assert seen == set(wire.REPORTS) | set(wire.COMMANDS)


def test_a_path_for_lora_takes_a_quarter_and_is_off_by_millimetres(rng: np.random.Generator) -> None:
    turn = np.linspace(0.0, 1.5, 30)
    path = np.stack((3.0 + np.sin(turn), -1.0 - np.cos(turn), turn), axis=1).astype(np.float32)
    message = NumberedCommand(7, GoTo(3, path))
    brief = encode(message, brief=True)
    assert len(brief) < 0.35 * len(encode(message))
    decoded = Decoder().decode(brief)
    assert isinstance(decoded, NumberedCommand)
    assert isinstance(decoded.command, GoTo)
    np.testing.assert_allclose(decoded.command.path, path, atol=0.0026)


def test_a_pulse_fits_into_one_short_item_of_lora_with_all_heads() -> None:
    assert len(encode(samples.pulse())) <= 29


def test_every_version_is_told_from_what_observations_begin_with() -> None:
    assert 0 < wire.VERSION < 7


def test_ranges_keep_a_millimetre_and_their_gaps(rng: np.random.Generator) -> None:
    sent = samples.observation(rng)
    received = Decoder().decode(encode(sent))
    assert isinstance(received, Observation)
    np.testing.assert_array_equal(np.isnan(received.ranges_m), np.isnan(sent.ranges_m))
    np.testing.assert_allclose(received.ranges_m, sent.ranges_m, atol=0.00051)


def test_a_smooth_scan_takes_little_more_than_a_byte_a_beam(rng: np.random.Generator) -> None:
    sent = dataclasses.replace(
        samples.observation(rng, nodes=0), ranges_m=(2 + 0.02 * np.sin(np.arange(227) / 9)).astype(np.float32)
    )
    assert len(encode(sent)) < 227 + 100


def test_a_value_that_was_not_measured_stays_unmeasured() -> None:
    decoded = Decoder().decode(encode(samples.telemetry(battery_v=float("nan"), motor_current_a=float("inf"))))
    assert isinstance(decoded, Telemetry)
    assert np.isnan(decoded.battery_v)
    assert np.isnan(decoded.motor_current_a)


def test_a_decoded_array_cannot_be_changed(rng: np.random.Generator) -> None:
    decoded = Decoder().decode(encode(samples.observation(rng)))
    assert isinstance(decoded, Observation)
    with pytest.raises(ValueError, match="read-only"):
        decoded.ranges_m[0] = 1.0


def test_every_single_flipped_bit_is_noticed(rng: np.random.Generator) -> None:
    datagram = encode(samples.telemetry())
    for bit in range(8 * len(datagram)):
        damaged = bytearray(datagram)
        damaged[bit // 8] ^= 1 << bit % 8
        assert Decoder().decode(bytes(damaged)) is None


def test_another_version_is_counted_and_named() -> None:
    decoder = Decoder()
    body = bytes((wire.VERSION + 1,)) + encode(samples.telemetry())[1:-4]
    assert decoder.decode(body + zlib.crc32(body).to_bytes(4, "little")) is None
    assert (decoder.counts.other_version, decoder.counts.other_version_seen) == (1, wire.VERSION + 1)


def sealed(type_id: int, body: bytes) -> bytes:
    head = bytes((wire.VERSION, type_id)) + body
    return head + zlib.crc32(head).to_bytes(4, "little")


@given(st.sampled_from([*sorted(wire.REPORTS | wire.COMMANDS), 0, 200]), st.binary(max_size=400))
def test_a_body_of_random_bytes_with_a_right_crc_never_raises(type_id: int, body: bytes) -> None:
    decoder = Decoder()
    decoded = decoder.decode(sealed(type_id, body))
    assert (decoded is None) == (decoder.counts.good == 0)


@given(st.integers(0, 11), st.data())
def test_a_message_with_changed_bytes_and_a_right_crc_never_raises(index: int, data: st.DataObject) -> None:
    datagram = bytearray(encode(samples.every_message(np.random.default_rng(1))[index])[:-4])
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(2, max(2, len(datagram) - 1)))
        if at < len(datagram):
            datagram[at] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(2, len(datagram)))
    Decoder().decode(sealed(datagram[1], bytes(datagram[2:cut])))


def test_edges_that_name_no_node_are_refused(rng: np.random.Generator) -> None:
    sent = samples.observation(rng, nodes=3)
    object.__setattr__(sent.objects, "edges", np.array([[0, 9]], np.uint16))
    decoder = Decoder()
    assert decoder.decode(encode(sent)) is None
    assert decoder.counts.malformed == 1
