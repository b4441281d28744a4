"""The demo's mission in lock-step, against the figures it must reach."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from robot_app.config import load_config as load_robot
from station_gui.build import build_pipeline
from station_gui.config import load_config as load_station
from tools.evaluate.summary import MissionSummary, summarise
from tools.replay import MissionSource, play
from tools.simulator.lockstep import Lockstep, MissionResult, run_mission
from tools.simulator.scenario import find_scenario

SEED = 1


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("mission") / "mission.mcap"


@pytest.fixture(scope="module")
def result(recording: Path) -> MissionResult:
    return run_mission(
        find_scenario("lab"),
        SEED,
        load_robot(None),
        load_station(None),
        say=lambda _: None,
        progress=lambda _: None,
        recording=recording,
    )


@pytest.fixture(scope="module")
def summary(result: MissionResult) -> MissionSummary:
    goal = find_scenario("lab").goals[-1].position_m
    return summarise(result.truth, result.snapshot, result.figures, result.outcome, goal)


def test_the_mission_is_finished_without_touching_anything(summary: MissionSummary) -> None:
    assert summary.failure == ""
    assert summary.collisions == 0


def test_the_map_is_true_and_complete(summary: MissionSummary) -> None:
    assert summary.map_rmse_m <= 0.015
    assert summary.map_completeness >= 0.90


def test_the_trajectory_is_true(summary: MissionSummary) -> None:
    assert summary.pose_rmse_m <= 0.015


def test_the_goal_is_reached(summary: MissionSummary) -> None:
    assert summary.goal_error_m <= 0.05


def test_the_operator_sees_a_new_map_five_times_a_second(summary: MissionSummary) -> None:
    assert summary.refresh_hz >= 5.0
    assert summary.observations_dropped == 0


def test_a_room_can_be_seen_in_3d(result: MissionResult) -> None:
    assert result.snapshot is not None
    objects = result.snapshot.objects
    segments = objects.segments_m
    assert 60 < len(segments) < 300
    assert 20 < len(np.unique(objects.cluster)) < 60  # 31 things stand in the room, and each is there once
    assert len(objects.panels.corners_m) > 30
    heights = segments[:, :, 2]
    assert heights.min() > -0.1
    assert np.percentile(heights, 99) < 1.6


def test_the_recording_gives_the_same_map_again_bit_for_bit(result: MissionResult, recording: Path) -> None:
    assert result.snapshot is not None
    pipeline = build_pipeline(load_station(None))
    play(MissionSource(recording), pipeline, "again")
    again = pipeline.snapshot()
    np.testing.assert_array_equal(again.grid.probability, result.snapshot.grid.probability)
    np.testing.assert_array_equal(again.trajectory, result.snapshot.trajectory)
    np.testing.assert_array_equal(again.objects.segments_m, result.snapshot.objects.segments_m)


def test_the_same_seed_gives_the_same_mission_bit_for_bit() -> None:
    poses = []
    for _ in range(2):
        system = Lockstep(find_scenario("lab"), SEED, load_robot(None), load_station(None))
        system.station.connect("loopback", 0)
        system.run(3.0)
        system.station.start()
        system.run(5.0)
        system.close()
        snapshot = system.station.finish_mapping()
        assert snapshot is not None
        poses.append((system.truth().poses, snapshot.trajectory))
    np.testing.assert_array_equal(poses[0][0], poses[1][0])
    np.testing.assert_array_equal(poses[0][1], poses[1][1])
