from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from shared.link.base import Lane
from shared.link.loopback import loopback_pair
from shared.protocol.observations import ObservationEncoder
from shared.runtime.clock import ManualClock
from tools.evaluate.link.on_missions import link_figures
from tools.evaluate.link.timeline_picture import draw_timeline
from tools.fuzz.room_drive import drive
from tools.simulator.links import Cut
from tools.simulator.witness import Side, Witness


def test_figures_of_a_link_that_carries_compact_observations(rng: np.random.Generator) -> None:
    clock, witness, encoder = ManualClock(), Witness(), ObservationEncoder(lambda o: o)
    robot, station = loopback_pair()
    there, here = witness.watch(robot, Side.ROBOT, clock), witness.watch(station, Side.STATION, clock)
    sizes = []
    for k, observation in enumerate(drive(20, rng)):
        encoded = encoder.encode(observation)
        assert encoded.compact is not None
        sent = witness.taken(Side.ROBOT, encoded.full, Lane.BULK, clock.now_s())
        assert sent is not None
        witness.has_version(Side.ROBOT, encoded.compact, sent)
        robot.send(encoded.compact)
        sizes.append(len(encoded.compact))
        clock.advance(0.1 if k != 9 else 0.4)
        here.receive(0.0)
    there.send(b"an order's answer", Lane.COMMAND)
    figures = link_figures(witness, (Cut(0.5, 0.9), Cut(1.7, 1.8)), end_s=10.0)
    assert (figures.observations, figures.over_lora, figures.lost, figures.duplicated) == (20, 20, 1, 0)
    assert figures.lora_bytes_mean == pytest.approx(np.mean(sizes))
    assert figures.gap_ms_max == figures.cut_gap_ms_max == pytest.approx(400.0)
    assert figures.latency_ms_p50 == pytest.approx(100.0)
    assert 0.0 < figures.range_error_m <= 0.01001
    assert 0.0 < figures.node_error_m <= 0.02
    assert figures.beyond_1_cm == figures.beams_left_out == figures.nodes_left_out == 0


def test_a_mission_without_a_single_observation_has_figures_too() -> None:
    figures = link_figures(Witness(), (), end_s=1.0)
    assert figures.observations == figures.lost == 0
    assert math.isfinite(figures.gap_ms_max)


def test_the_timeline_shows_strokes_and_what_happened(tmp_path: Path) -> None:
    path = tmp_path / "timeline.png"
    draw_timeline(np.arange(0.0, 30.0, 0.1), [("plug pulled", 10.0, 12.0)], path, title="A mission")
    colours = {colour for _, colour in Image.open(path).convert("RGB").getcolors(1 << 20) or []}
    assert {(44, 108, 214), (250, 222, 214)} <= colours
