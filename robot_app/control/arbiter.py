"""Whose motion the car obeys: emergency before operator's hand before path before wall."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from robot_app.control.motion import STAND_STILL, Motion


class Source(IntEnum):
    """Who has the car, the most important last."""

    NOBODY = 0
    WALL = 1
    PATH = 2
    MANUAL = 3
    HALT = 4


@dataclass(frozen=True, slots=True)
class Choice:
    source: Source
    motion: Motion


def choose(halt: bool, manual: Motion | None, path: Motion | None, wall: Motion | None) -> Choice:
    """The motion that counts; it then goes through the obstacle avoidance. None: this source asks for nothing.

    `halt`: an emergency stop or any reason to stand; it wins over everything.
    """
    if halt:
        return Choice(Source.HALT, STAND_STILL)
    for source, motion in ((Source.MANUAL, manual), (Source.PATH, path), (Source.WALL, wall)):
        if motion is not None:
            return Choice(source, motion)
    return Choice(Source.NOBODY, STAND_STILL)
