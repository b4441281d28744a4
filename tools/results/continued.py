"""A log in two sessions: the first half's map is stored, and a station that knows nothing else goes on with it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from station_gui.build import build_slam
from station_gui.mapping.saved_map import decode, encode
from tools.evaluate.playing import Method, Part, play, shipped, shipped_slam
from tools.evaluate.slam import read_relations, relation_errors
from tools.logs.carmen import CarmenReader


@dataclass(frozen=True, slots=True)
class ContinuedFigures:
    """Errors of the relations between scans of the second session that came while the robot was found, and keyframes of
    the first, as one map has them. `found_after`: so many scans of the second session.
    """

    scans: int
    keyframes_given: int
    found_after: int
    unlocated: int
    relations: int
    translation_mean_m: float
    translation_std_m: float
    rotation_mean_deg: float
    rotation_std_deg: float
    map_bytes: int


def measure(log: Path, relations: Path, method: Method) -> ContinuedFigures:
    observations = list(CarmenReader(log))
    half = len(observations) // 2
    before = shipped_slam(method, 0)
    play(Part(observations[:half]), before)
    stored = encode(before.saved())
    given = decode(stored)
    slam = build_slam(shipped(method, 0), given)
    played = play(Part(observations[half:]), slam)
    old = slam.trajectory()[: len(given.keyframes)]
    stamps_s = np.concatenate((old[:, 0], played.stamps_s[played.located]))
    poses = np.concatenate((old[:, 1:], played.poses[played.located]))
    shift_m, turn_rad = relation_errors(stamps_s, poses, read_relations(relations))
    return ContinuedFigures(
        scans=len(played.scans),
        keyframes_given=len(given.keyframes),
        found_after=int(np.argmax(played.located)) if played.located.any() else len(played.scans),
        unlocated=played.unlocated,
        relations=len(shift_m),
        translation_mean_m=float(shift_m.mean()),
        translation_std_m=float(shift_m.std()),
        rotation_mean_deg=float(np.degrees(turn_rad).mean()),
        rotation_std_deg=float(np.degrees(turn_rad).std()),
        map_bytes=len(stored),
    )
