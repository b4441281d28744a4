"""Commands on their way: which lane, how many bytes, what waits for an answer."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from shared.link.base import MAX_DATAGRAM_BYTES, Lane, Link
from shared.messages import Command, Drive, EmergencyStop, GoTo, NumberedCommand, Stop
from shared.protocol.codec import encode

HEARTBEAT_SLOT, DRIVE_SLOT, KEYFRAME_SLOT = 0, 1, 2  # of the newest
_BRIEF_SPACING_M = 0.1  # of the points of a path on LoRa, as `GoTo` asks for


@dataclass(slots=True)
class Pending:
    """A command that waits for its answer."""

    number: int
    command: Command
    datagram: bytes
    sent_s: float = -math.inf
    tries: int = 0

    @property
    def is_stop(self) -> bool:
        return isinstance(self.command, Stop | EmergencyStop)


def send(link: Link, pending: Pending) -> bool:
    """In the lane that it needs; over LoRa in as few bytes as it can be said in."""
    command = pending.command
    if isinstance(command, Drive):
        return link.send(pending.datagram, Lane.NEWEST, DRIVE_SLOT)
    brief = encode(NumberedCommand(pending.number, _thinned(command)), brief=True)
    return link.send(pending.datagram, Lane.NOW if pending.is_stop else Lane.COMMAND, for_radio=lambda: brief)


def _thinned(command: Command) -> Command:
    """A path with as few points as the robot needs; where it changes its direction stays."""
    if not isinstance(command, GoTo) or len(command.path) < 3:
        return command
    steps = np.diff(command.path[:, :2], axis=0)
    headings = command.path[:-1, 2]
    forward = steps[:, 0] * np.cos(headings) + steps[:, 1] * np.sin(headings) >= 0
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    kept, gone_m = [0], 0.0
    for i in range(1, len(command.path) - 1):
        gone_m += float(lengths[i - 1])
        if gone_m + float(lengths[i]) > _BRIEF_SPACING_M or forward[i] != forward[i - 1]:
            kept.append(i)
            gone_m = 0.0
    return GoTo(command.goal_id, command.path[[*kept, len(command.path) - 1]])


def datagram_of(number: int, command: Command) -> bytes:
    """Raises `ValueError` for a command that does not fit on the wire."""
    try:
        datagram = encode(NumberedCommand(number, command))
    except OverflowError as error:
        raise ValueError(str(error)) from error
    if len(datagram) > MAX_DATAGRAM_BYTES:
        raise ValueError(f"{len(datagram)} bytes are more than a datagram holds")
    return datagram
