from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from shared.messages import KeyframeWanted, ObjectNetwork, Observation
from shared.protocol.codec import Decoder, encode
from shared.protocol.observations import MessageDecoder, ObservationEncoder
from tests.shared import samples
from tools.fuzz.room_drive import drive


def test_whatever_path_each_observation_takes_no_keyframe_is_needed_after_the_first(rng: np.random.Generator) -> None:
    encoder, decoder = ObservationEncoder(lambda o: o), MessageDecoder(compact=True)
    keyframes = 0
    for observation in drive(30, rng):
        encoded = encoder.encode(observation)
        keyframes += encoded.keyframe
        assert encoded.compact is not None
        over_lora = bool(rng.random() < 0.5)
        received = decoder.decode(encoded.compact if over_lora else encoded.full)
        assert received is not None
        assert received.was_compact == over_lora
        assert isinstance(received.message, Observation)
        assert received.message.sequence == observation.sequence
        np.testing.assert_allclose(received.message.ranges_m, observation.ranges_m, atol=0.0101)
    assert keyframes == 1
    assert not decoder.wants_keyframe


def test_what_is_recorded_gives_exactly_what_was_mapped(rng: np.random.Generator) -> None:
    encoder, decoder = ObservationEncoder(lambda o: o), MessageDecoder(compact=True)
    for observation in drive(4, rng):
        received = decoder.decode(encoder.encode(observation).compact or b"")
        assert received is not None
        assert isinstance(received.message, Observation)
        again = Decoder().decode(received.datagram)
        assert isinstance(again, Observation)
        assert again.odom_from_robot == received.message.odom_from_robot
        np.testing.assert_array_equal(again.ranges_m, received.message.ranges_m)


def test_wifi_has_what_this_image_shows_and_lora_what_is_held_still(rng: np.random.Generator) -> None:
    measured, held = drive(1, rng)[0], ObjectNetwork(np.array([[1.0, 0, 0], [1.0, 0, 0.5]]), np.array([[0, 1]]))
    encoder = ObservationEncoder(lambda o: replace(o, objects=held, has_objects=True))
    encoded = encoder.encode(measured)
    whole, compact = (MessageDecoder(compact=True).decode(each) for each in (encoded.full, encoded.compact or b""))
    assert whole is not None
    assert compact is not None
    assert isinstance(whole.message, Observation)
    assert isinstance(compact.message, Observation)
    np.testing.assert_allclose(whole.message.objects.nodes_m, measured.objects.nodes_m, atol=0.0006)
    np.testing.assert_allclose(compact.message.objects.nodes_m, held.nodes_m, atol=0.02)


def test_who_lost_one_wants_a_keyframe_and_has_it_with_the_reset(rng: np.random.Generator) -> None:
    encoder, decoder = ObservationEncoder(lambda o: o), MessageDecoder(compact=True)
    first, _, third, fourth = (encoder.encode(o).compact or b"" for o in drive(4, rng))
    assert decoder.decode(first) is not None
    assert decoder.decode(third) is None
    assert decoder.decode(fourth) is None
    assert decoder.wants_keyframe
    encoder.reset()
    later = next(o for o in reversed(drive(9, rng)))
    encoded = encoder.encode(later)
    assert encoded.keyframe
    assert decoder.decode(encoded.compact or b"") is not None
    assert not decoder.wants_keyframe


def test_what_cannot_be_said_compactly_travels_whole(rng: np.random.Generator) -> None:
    observation = samples.observation(rng, beams=3000, nodes=0)
    encoded = ObservationEncoder(lambda o: o).encode(observation)
    assert encoded.compact is None
    received = MessageDecoder(compact=True).decode(encoded.full)
    assert received is not None
    assert isinstance(received.message, Observation)


def test_a_link_that_lets_anybody_in_takes_nothing_compact(rng: np.random.Generator) -> None:
    encoded = ObservationEncoder(lambda o: o).encode(drive(1, rng)[0])
    decoder = MessageDecoder(compact=False)
    assert decoder.decode(encoded.compact or b"") is None
    assert decoder.decode(encoded.full) is None


@pytest.mark.parametrize("compact", [True, False])
def test_other_messages_pass_and_garbage_does_not(rng: np.random.Generator, compact: bool) -> None:
    decoder = MessageDecoder(compact)
    received = decoder.decode(encode(KeyframeWanted()))
    assert received is not None
    assert received.message == KeyframeWanted()
    assert decoder.decode(b"") is None
    for _ in range(300):
        decoder.decode(rng.bytes(int(rng.integers(1, 90))))
    telemetry = decoder.decode(encode(samples.telemetry()))
    assert telemetry is not None
