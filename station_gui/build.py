"""Puts a station together, without a window."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from shared.link.base import Link
from shared.runtime.clock import Clock, wall_clock_name
from station_gui.comms.connect import Connector
from station_gui.comms.target import Target
from station_gui.config import StationConfig
from station_gui.mapping.pipeline import MappingPipeline
from station_gui.mapping.saved_map import SavedMap
from station_gui.mapping.slam2d.base import StoredSlam
from station_gui.mapping.slam2d.graph_slam import GraphSlam
from station_gui.mapping.slam2d.localisation.map_tracker import MapTracker
from station_gui.mapping.slam2d.localisation.self_locating import SelfLocatingSlam
from station_gui.mapping.slam2d.particle.particle_slam import ParticleSlam
from station_gui.model.station import NameRecording, Station
from station_gui.planning.path_planner import PathPlanner


def build_pipeline(config: StationConfig) -> MappingPipeline:
    return MappingPipeline(partial(build_slam, config), config.combine)


def build_slam(config: StationConfig, given: SavedMap | None = None, fixed: bool = False) -> SelfLocatingSlam:
    """From scratch or from a map that is given; `fixed`: the robot only follows itself in it."""
    inner = MapTracker(config.slam) if fixed and given is not None else build_method(config)
    return SelfLocatingSlam(config.localisation, config.slam.grid, inner, given, fixed=fixed)


def build_method(config: StationConfig) -> StoredSlam:
    """The SLAM that `method` names."""
    if config.method == "particle":
        return ParticleSlam(config.particle_slam, np.random.default_rng(config.particle_slam.seed))
    return GraphSlam(config.slam)


def build_station(
    config: StationConfig,
    clock: Clock,
    first_command: int,
    make_link: Callable[[str, int], Link] | None = None,
    name_recording: NameRecording | None = None,
) -> Station:
    """A station that connects and records as configured, unless told otherwise."""

    connector = Connector(clock, config.session.connect_timeout_s, config.pairing, config.radio)

    def make(target: Target) -> Link:
        return connector(target) if make_link is None else make_link(target.host, target.port)

    return Station(
        config.session,
        clock,
        make,
        partial(build_pipeline, config),
        config.car,
        PathPlanner(config.car, config.planning, clock.now_s),
        name_recording or partial(_name_recording, config.recording.folder),
        first_command,
    )


def _name_recording(folder: str) -> Path | None:
    return Path(folder) / f"mission-{wall_clock_name()}.mcap" if folder else None
