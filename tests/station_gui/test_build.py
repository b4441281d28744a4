from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from shared.config import ConfigError
from station_gui.build import build_method
from station_gui.config import DEFAULT_PATH, load_config
from station_gui.mapping.slam2d.graph_slam import GraphSlam
from station_gui.mapping.slam2d.particle.particle_slam import ParticleSlam


def test_the_station_maps_by_the_method_that_its_file_names(tmp_path: Path) -> None:
    text = DEFAULT_PATH.read_text("utf-8")
    other = tmp_path / "station.toml"
    other.write_text(text.replace('method = "graph"', 'method = "particle"'), "utf-8")

    assert isinstance(build_method(load_config(None)), GraphSlam)
    assert isinstance(build_method(load_config(other)), ParticleSlam)


def test_graph_slam_is_what_a_file_without_a_method_gets() -> None:
    fields = {field.name: field.default for field in dataclasses.fields(type(load_config(None)))}
    assert fields["method"] == "graph"


def test_a_method_that_is_not_known_is_refused_by_its_name(tmp_path: Path) -> None:
    path = tmp_path / "station.toml"
    path.write_text(DEFAULT_PATH.read_text("utf-8").replace('method = "graph"', 'method = "kalman"'), "utf-8")
    with pytest.raises(ConfigError, match="method must be one of 'graph', 'particle', not 'kalman'"):
        load_config(path)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("[particle_slam]\nparticles = 0", "particles must be 1 to 1000"),
        ("[particle_slam]\nseed = -1", "seed must not be negative"),
        ("[particle_slam.maps]\nreach_cells = 9", "reach_cells must be 1 to 7"),
        ("[particle_slam.maps]\nmax_blocks = 0", "must be positive"),
    ],
    ids=str,
)
def test_numbers_that_make_no_filter_are_refused(tmp_path: Path, line: str, told: str) -> None:
    path = tmp_path / "station.toml"
    text = DEFAULT_PATH.read_text("utf-8").replace("[particle_slam.grid]\ncell_m = 0.02", line)
    path.write_text(text, "utf-8")
    with pytest.raises(ConfigError, match=told):
        load_config(path)
