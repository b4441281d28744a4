from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork, Observation, ScanGeometry
from shared.protocol.codec import encode as encode_full
from shared.protocol.compact.decoder import Decoder
from shared.protocol.compact.encoder import DETAILS, Encoder
from shared.protocol.compact.warm_up import warm_up
from tests.shared import samples
from tools.fuzz.room_drive import drive


def assert_near(sent: Observation, got: Observation) -> None:
    """Within the profile's error bounds, and nothing missing."""
    assert (got.sequence, got.boot_id, got.has_objects) == (sent.sequence, sent.boot_id, sent.has_objects)
    assert got.stamp_s == pytest.approx(sent.stamp_s, abs=5.1e-4)
    assert (
        math.hypot(
            got.odom_from_robot.x_m - sent.odom_from_robot.x_m, got.odom_from_robot.y_m - sent.odom_from_robot.y_m
        )
        < 1e-3
    )
    assert abs(math.remainder(got.odom_from_robot.theta_rad - sent.odom_from_robot.theta_rad, math.tau)) < 4e-4
    assert got.speed_mps == pytest.approx(sent.speed_mps, abs=2.6e-3)
    assert got.yaw_rate_radps == pytest.approx(sent.yaw_rate_radps, abs=1.6e-3)
    assert got.geometry.step_rad == pytest.approx(sent.geometry.step_rad)
    valid = np.isfinite(sent.ranges_m)
    assert (np.isfinite(got.ranges_m) == valid).all()
    if valid.any():
        assert np.abs(got.ranges_m - sent.ranges_m)[valid].max() <= 0.01 + 1e-6
    assert_same_network(sent.objects, got.objects)


def assert_same_network(sent: ObjectNetwork, got: ObjectNetwork) -> None:
    assert len(got.nodes_m) == len(sent.nodes_m)
    if len(sent.nodes_m) == 0:
        return
    distance = np.linalg.norm(sent.nodes_m[:, None, :] - got.nodes_m[None, :, :], axis=2)
    stands_for = distance.argmin(axis=1)
    assert distance.min(axis=1).max() < 0.02
    if len(set(stands_for.tolist())) == len(stands_for):
        wanted = {frozenset((int(stands_for[a]), int(stands_for[b]))) for a, b in sent.edges.tolist() if a != b}
        assert {frozenset(pair) for pair in got.edges.tolist()} == wanted


def test_a_drive_comes_through_within_the_bounds_and_small(rng: np.random.Generator) -> None:
    encoder, decoder, sizes = Encoder(in_order=True), Decoder(), []
    for observation in drive(40, rng):
        datagram = encoder.encode(observation).datagram
        sizes.append(len(datagram))
        got = decoder.decode(datagram)
        assert got is not None
        assert_near(observation, got)
    assert decoder.counts.good == 40
    assert np.mean(sizes[10:]) < 0.15 * len(encode_full(observation))


def test_objects_that_are_still_there_are_not_sent_again(rng: np.random.Generator) -> None:
    encoder = Encoder(in_order=True)
    sizes = [encoder.encode(observation).sizes for observation in drive(30, rng)]
    objects = [size.objects - size.scan for size in sizes]
    assert objects[0] >= 10
    assert np.mean(objects[5:]) < 1


def test_ranges_that_are_no_whole_millimetres_stay_within_a_centimetre(rng: np.random.Generator) -> None:
    encoder, decoder = Encoder(in_order=True), Decoder()
    for observation in drive(5, rng):
        ranges = observation.ranges_m + np.float32(0.0004) * rng.random(len(observation.ranges_m)).astype(np.float32)
        moved = replace(observation, ranges_m=ranges)
        got = decoder.decode(encoder.encode(moved).datagram)
        assert got is not None
        assert_near(moved, got)


def test_anything_a_scanner_can_say_comes_through(rng: np.random.Generator) -> None:
    encoder, decoder = Encoder(in_order=True), Decoder()
    for k in range(6):
        drawn = replace(samples.observation(rng, sequence=k, nodes=40), odom_from_robot=Pose2(9.0 * k, -k, 2.0 * k))
        ranges = (np.round(1e3 * drawn.ranges_m) / 1e3).astype(np.float32)
        observation = replace(drawn, ranges_m=ranges)
        got = decoder.decode(encoder.encode(observation).datagram)
        assert got is not None
        assert_near(observation, got)


def test_a_scanner_may_be_changed_on_the_way(rng: np.random.Generator) -> None:
    encoder, decoder = Encoder(in_order=True), Decoder()
    first, second, third = drive(3, rng)
    other = ScanGeometry(-1.0, 0.01, 0.0, 0.1, 8.0, Pose2(0.1, 0.02, 0.5))
    second = replace(second, geometry=other, ranges_m=second.ranges_m[:100])
    for observation in (first, second, replace(third, ranges_m=np.zeros(0, np.float32))):
        got = decoder.decode(encoder.encode(observation).datagram)
        assert got is not None
        assert_near(observation, got)
        assert len(got.ranges_m) == len(observation.ranges_m)


def test_a_large_network_comes_through_over_the_store_s_size(rng: np.random.Generator) -> None:
    encoder, decoder = Encoder(in_order=True), Decoder()
    for k, seen in enumerate(drive(8, rng)):
        nodes = rng.uniform(-3, 3, (150, 3)).astype(np.float32)
        chain = np.stack((np.arange(149), np.arange(1, 150)), axis=1).astype(np.uint16)
        observation = replace(seen, sequence=k, objects=ObjectNetwork(nodes, chain))
        got = decoder.decode(encoder.encode(observation).datagram)
        assert got is not None
        assert_same_network(observation.objects, got.objects)


def test_a_budget_is_met_and_what_was_left_out_follows(rng: np.random.Generator) -> None:
    encoder, decoder = Encoder(in_order=True), Decoder()
    levels, got = [], None
    for observation in drive(60, rng):
        encoded = encoder.encode(observation, max_bytes=70)
        assert len(encoded.datagram) <= 70
        levels.append(encoded.level)
        got = decoder.decode(encoded.datagram)
        assert got is not None
    assert levels[0] > 0
    assert decoder.counts.reduced == np.count_nonzero(levels)
    assert levels[-1] == 0
    assert got is not None
    assert_near(observation, got)


def test_a_budget_is_met_within_five_attempts_and_leaves_out_no_more_than_it_must(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    attempts: list[tuple[int, int]] = []
    attempt = Encoder._attempt

    def counted(encoder: Encoder, sending: Any, level: int) -> Any:
        made = attempt(encoder, sending, level)
        attempts.append((level, len(made[0].datagram)))
        return made

    monkeypatch.setattr(Encoder, "_attempt", counted)
    encoder = Encoder()
    observation = drive(1, rng)[0]
    for max_bytes in range(10, 300, 15):
        encoder.reset()
        attempts.clear()
        encoded = encoder.encode(observation, max_bytes)
        assert len(attempts) <= 5
        taken = min(level for level, size in attempts if size == len(encoded.datagram))
        assert len(encoded.datagram) <= max_bytes or taken == len(DETAILS) - 1
        assert all(size > max_bytes for level, size in attempts if level < taken)


def test_far_and_high_nodes_come_through(rng: np.random.Generator) -> None:
    nodes = np.array([(0.0, 0.0, 0.0), (900.0, -700.0, 30.0), (1.0, 1.0, -20.0)], np.float32)
    observation = replace(drive(1, rng)[0], objects=ObjectNetwork(nodes, np.array([(0, 1), (1, 2)], np.uint16)))
    got = Decoder().decode(Encoder().encode(observation).datagram)
    assert got is not None
    assert_same_network(observation.objects, got.objects)


def test_warming_up_leaves_nothing_behind() -> None:
    warm_up()
    assert Encoder().newest is None


def test_what_the_profile_cannot_carry_is_refused(rng: np.random.Generator) -> None:
    observation = drive(1, rng)[0]
    for bad in (
        replace(observation, stamp_s=math.nan),
        replace(observation, odom_from_robot=Pose2(math.inf, 0.0, 0.0)),
        replace(observation, speed_mps=1e6),
        replace(observation, ranges_m=np.ones(5000, np.float32)),
        replace(observation, geometry=replace(observation.geometry, step_rad=-0.01)),
    ):
        with pytest.raises(ValueError, match=r"\w"):
            Encoder().encode(bad)
