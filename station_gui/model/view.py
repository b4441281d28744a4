"""What the operator sees and may do, with no Qt in it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from shared.link.base import LinkHealth, LinkPath
from shared.messages import Hello, Observation, Telemetry, Vitals
from station_gui.comms.state import LinkState, Severity
from station_gui.comms.target import Target
from station_gui.mapping.snapshot import MapSnapshot
from station_gui.model.goal_figures import GoalFigures

__all__ = ["LinkFigures", "LinkState", "LogEntry", "Operator", "OperatorView", "Severity", "Target"]


@dataclass(frozen=True, slots=True)
class LogEntry:
    time_s: float  # station clock
    severity: Severity
    text: str


@dataclass(frozen=True, slots=True)
class LinkFigures:
    """How the link does, over the last seconds."""

    observations_hz: float
    refresh_hz: float  # map updates per second that reached the operator
    bytes_per_observation: float
    received_bps: float
    round_trip_s: float  # of the last acknowledged command; NaN before the first
    path: LinkPath | None = None  # what the observations come over; None without a connection
    health: LinkHealth = field(default_factory=LinkHealth)
    problem: str = ""  # what keeps it from connecting


@dataclass(frozen=True, slots=True, eq=False)
class OperatorView:
    """Everything a window may draw, at one moment. Made anew on each call: cheap, immutable, any thread."""

    time_s: float
    link_state: LinkState
    target: Target  # empty before the first connection
    link: LinkFigures
    robot: Hello | None
    telemetry: Telemetry | None  # None until the first has come
    telemetry_age_s: float  # infinite until the first has come
    observation: Observation | None  # the newest
    snapshot: MapSnapshot | None
    goal_m: tuple[float, float] | None  # map frame
    path_m: NDArray[np.float64] | None  # (N, 2), map frame
    recording: str  # path of the recording, empty when there is none
    log_length: int  # how many log entries there have been
    vitals: Vitals | None = None  # of the robot's computer, the newest
    going: GoalFigures | None = None  # of the goal that was asked for last


class Operator(Protocol):
    """What a window may ask of the station. Nothing here blocks or raises; the outcome shows in the view and log."""

    def view(self) -> OperatorView: ...
    def log_since(self, index: int) -> list[LogEntry]:
        """The entries from the index-th on; old ones may be gone."""
        ...

    def connect(self, host: str, port: int, radio_ports: tuple[str, ...] = ()) -> None:
        """Over Wi-Fi where there is a host, over LoRa where there are ports, over both by turns."""
        ...

    def serial_ports(self) -> list[str]:
        """Where a radio may be plugged in."""
        ...

    def disconnect(self) -> None: ...
    def start(self) -> None: ...
    def stop(self) -> None: ...
    def pause(self) -> None: ...
    def resume(self) -> None:
        """Go on with the mission that was paused, halted or cut off."""
        ...

    def return_to_start(self) -> None: ...
    def emergency_stop(self) -> None: ...
    def go_to(self, x_m: float, y_m: float) -> None:
        """Plan to this point of the map and send the robot there; a refusal is logged with its reason."""
        ...

    def save_map(self, path: Path) -> None:
        """Write the present map to this file."""
        ...

    def export_map(self, folder: Path) -> None:
        """Write the present map into this folder in the formats that other programs read."""
        ...

    def open_map(self, path: Path, *, localise: bool) -> None:
        """Forget the present map for the one in this file: to go on with, or only to localise in."""
        ...

    def drive(self, speed_mps: float, steering_rad: float) -> None:
        """Drive by hand; holds for half a second."""
        ...
