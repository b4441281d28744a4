"""Keeps the mission's record in a small file, so that it survives the app, and the power.

The file is written anew beside the old one, forced to the disk and put in its place: it is whole or the old one,
whatever happens. A file that cannot be read, or is not ours, is no mission.
"""

from __future__ import annotations

import json
import logging
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from robot_app.mission import MissionRecord
from shared.geometry.se2 import Pose2
from shared.messages import MissionState, StopReason

_log = logging.getLogger(__name__)
FILE_NAME = "mission.json"
_FORMAT = 1
_MOST_BYTES = 4096
_EVERY_S = 2.0  # while nothing but the way driven changes


def open_store(folder: str, of_service: str | None) -> MissionStore | None:
    """In `folder`, or where that is empty in the first of the folders that systemd names; None without either."""
    place = folder or (of_service or "").split(":")[0]
    return MissionStore(Path(place).expanduser()) if place else None


class MissionStore:
    """One thread. It never raises: without a disk the mission goes on, and that is logged when it begins."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / FILE_NAME
        self._written = MissionRecord()
        self._written_s: float | None = None
        self._failed = False

    def load(self) -> MissionRecord:
        """What was kept; an empty record where nothing was, or nothing that can be read."""
        try:
            data = self._path.read_bytes()[: _MOST_BYTES + 1]
        except OSError:
            return MissionRecord()
        try:
            record = _from_table(json.loads(data))
        except (ValueError, TypeError, KeyError, OverflowError, RecursionError) as error:
            _log.warning("%s is not read: %s", self._path, error)
            return MissionRecord()
        return record

    def keep(self, record: MissionRecord, now_s: float) -> None:
        """At once where the mission's state has changed; every two seconds where only the way has, or it failed."""
        if record == self._written and not self._failed:
            return
        moved_only = replace(record, distance_m=0.0, robot_from_home=None) == replace(
            self._written, distance_m=0.0, robot_from_home=None
        )
        waits = moved_only or self._failed
        if waits and self._written_s is not None and now_s - self._written_s < _EVERY_S:
            return
        self._written, self._written_s = record, now_s
        try:
            _replace(self._path, json.dumps(_to_table(record)).encode("ascii"))
        except OSError as error:
            if not self._failed:
                _log.warning("the mission's state is not kept: %s", error)
            self._failed = True
            return
        self._failed = False


def _replace(path: Path, data: bytes) -> None:
    beside = path.with_suffix(".new")
    with beside.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    beside.replace(path)
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _to_table(record: MissionRecord) -> dict[str, Any]:
    home = record.robot_from_home
    return asdict(record) | {
        "format": _FORMAT,
        "going_on": record.going_on.name,
        "stop_reason": record.stop_reason.name,
        "robot_from_home": None if home is None else home.as_array().tolist(),
    }


def _from_table(table: Any) -> MissionRecord:
    if not isinstance(table, Mapping) or table["format"] != _FORMAT:
        raise ValueError("it is of another format")
    distance_m, home = float(table["distance_m"]), table["robot_from_home"]
    place = None if home is None else Pose2(*(float(value) for value in home))
    if not all(math.isfinite(value) for value in (distance_m, *(place.as_array() if place is not None else ()))):
        raise ValueError("it holds what is no number")
    return MissionRecord(
        MissionState[table["going_on"]],
        bool(table["is_round_over"]),
        bool(table["is_observed"]),
        StopReason[table["stop_reason"]],
        distance_m,
        place,
    )
