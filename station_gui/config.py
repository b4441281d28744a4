"""Everything that can be set about the station, as `station.toml` holds it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from shared.config import load
from shared.geometry.ackermann import CarGeometry
from shared.link.radio_config import RadioConfig
from station_gui.comms.session import SessionConfig
from station_gui.mapping.objects.config import CombineConfig
from station_gui.mapping.slam2d.config import GraphSlamConfig
from station_gui.mapping.slam2d.localisation.config import LocalisationConfig
from station_gui.mapping.slam2d.particle.config import ParticleSlamConfig
from station_gui.planning.config import PlannerConfig
from station_gui.views.config import WindowConfig

DEFAULT_PATH = Path(__file__).with_name("station.toml")


@dataclass(frozen=True, slots=True)
class RecordingConfig:
    folder: str = "recordings"  # one file per connection; empty records nothing


@dataclass(frozen=True, slots=True)
class StationConfig:
    car: CarGeometry
    method: Literal["graph", "particle"] = "graph"  # of 2D SLAM
    pairing: str = ""  # file of `radio-config key new`, the same on the robot; empty speaks with any robot
    radio: RadioConfig = field(default_factory=RadioConfig)
    session: SessionConfig = field(default_factory=SessionConfig)
    slam: GraphSlamConfig = field(default_factory=GraphSlamConfig)
    particle_slam: ParticleSlamConfig = field(default_factory=ParticleSlamConfig)
    localisation: LocalisationConfig = field(default_factory=LocalisationConfig)
    combine: CombineConfig = field(default_factory=CombineConfig)
    planning: PlannerConfig = field(default_factory=PlannerConfig)
    window: WindowConfig = field(default_factory=WindowConfig)
    recording: RecordingConfig = field(default_factory=RecordingConfig)


def load_config(path: Path | None) -> StationConfig:
    """The file at `path`, or the one that comes with the station. Raises `ConfigError`."""
    return load(path or DEFAULT_PATH, StationConfig)
