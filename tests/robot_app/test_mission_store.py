from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from robot_app.mission import MissionRecord
from robot_app.mission_store import FILE_NAME, MissionStore
from shared.geometry.se2 import Pose2
from shared.messages import MissionState, StopReason

RECORD = MissionRecord(MissionState.OBSERVE, True, False, StopReason.NONE, 4.25, Pose2(1.0, -0.5, 0.25))


def test_a_record_is_read_back_as_it_was_kept(tmp_path: Path) -> None:
    MissionStore(tmp_path).keep(RECORD, 0.0)
    assert MissionStore(tmp_path).load() == RECORD
    assert [path.name for path in tmp_path.iterdir()] == [FILE_NAME]


def test_the_way_is_written_every_two_seconds_and_a_change_of_state_at_once(tmp_path: Path) -> None:
    store = MissionStore(tmp_path)
    store.keep(RECORD, 0.0)
    store.keep(replace(RECORD, distance_m=4.5), 1.0)
    assert store.load().distance_m == 4.25
    store.keep(replace(RECORD, distance_m=4.75), 2.1)
    assert store.load().distance_m == 4.75
    store.keep(replace(RECORD, stop_reason=StopReason.EMERGENCY, distance_m=5.0), 2.2)
    assert store.load().distance_m == 5.0


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "\udcff",
        "[" * 5000,
        json.dumps({"format": 2}),
        json.dumps({"format": 1, "going_on": "FLY", "distance_m": 1.0, "robot_from_home": None}),
        json.dumps({"format": 1, "going_on": "OBSERVE", "distance_m": float("nan"), "robot_from_home": None}),
        json.dumps({"format": 1, "going_on": "OBSERVE", "distance_m": 1.0, "robot_from_home": [1.0]}),
        json.dumps({"format": 1, "going_on": "OBSERVE", "distance_m": 10**400, "robot_from_home": None}),
    ],
)
def test_what_cannot_be_read_is_no_mission(tmp_path: Path, text: str) -> None:
    (tmp_path / FILE_NAME).write_bytes(text.encode("utf-8", "surrogateescape"))
    assert MissionStore(tmp_path).load() == MissionRecord()


def test_without_a_folder_nothing_is_kept_and_nothing_breaks(tmp_path: Path) -> None:
    store = MissionStore(tmp_path / "gone")
    store.keep(RECORD, 0.0)
    store.keep(replace(RECORD, is_observed=True), 0.1)
    assert store.load() == MissionRecord()


def test_what_a_full_disk_did_not_take_is_kept_once_there_is_room(tmp_path: Path) -> None:
    full = tmp_path / "full"
    store = MissionStore(full)
    store.keep(RECORD, 0.0)
    full.mkdir()
    store.keep(RECORD, 1.0)  # not at each tick: a card that fails takes its time to say so
    assert list(full.iterdir()) == []
    store.keep(RECORD, 2.1)
    assert store.load() == RECORD
