from __future__ import annotations

from argparse import ArgumentTypeError
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from robot_app.config import load_config as load_robot
from shared.command_line import Refused
from station_gui.config import load_config as load_station
from tools.evaluate.mapping.command import figures_of, link_list, over_trials, step_list
from tools.evaluate.mapping.pictures import draw_beside_truth, draw_overlay
from tools.evaluate.mapping.trial import Trial, is_recorded, map_again, simulate
from tools.simulator.scenario import find_scenario


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first nine seconds of a mission in the lab, six of them driven."""
    place = tmp_path_factory.mktemp("trials") / "lab-tcp-3"
    place.mkdir()
    (place / "mission.mcap").write_bytes(b"of a mission that was interrupted")
    told: list[float] = []
    simulate(find_scenario("lab"), "tcp", 3, load_robot(None), load_station(None), place, told.append, minutes=0.15)
    assert told[-1] == pytest.approx(9.0)
    return place


@pytest.fixture(scope="module")
def trial(folder: Path) -> Trial:
    return map_again(folder, load_station(None))


def test_a_recorded_trial_tells_what_only_the_mission_knew(folder: Path, trial: Trial) -> None:
    assert is_recorded(folder)
    assert not is_recorded(folder.parent)
    assert (trial.driven.scenario, trial.driven.link, trial.driven.seed) == ("lab", "tcp", 3)
    assert trial.driven.finished
    assert trial.driven.refresh_hz > 5.0


def test_the_map_of_a_recording_is_compared_with_the_truth_of_its_room(trial: Trial) -> None:
    assert trial.map_error.map_rmse_m < 0.02
    assert trial.object_error.object_rmse_m < 0.05
    assert trial.object_error.true_objects >= 1
    assert len(trial.costs.slam) == len(trial.costs.combine) > 50


def test_a_recording_gives_the_same_map_again(folder: Path, trial: Trial) -> None:
    again = map_again(folder, load_station(None))
    np.testing.assert_array_equal(again.objects.segments_m, trial.objects.segments_m)
    assert again.object_error == trial.object_error


def test_the_report_has_every_figure_of_each_trial_and_of_all(trial: Trial) -> None:
    report = over_trials([trial, trial])
    asked = (
        "map_rmse_m", "map_completeness", "object_rmse_m", "object_recall", "phantom_objects", "height_error_m",
        "slam_ms_p50", "slam_ms_p99", "combine_ms_p50", "combine_ms_p99", "bytes_per_observation", "refresh_hz",
    )  # fmt: skip
    assert set(asked) <= report.keys()
    assert set(asked) <= figures_of(trial).keys()
    assert report["repeatability_m"] == 0.0
    assert len(report["trials"]) == 2


def test_pictures_of_trials_are_drawn(trial: Trial, tmp_path: Path) -> None:
    draw_overlay([trial, trial], tmp_path / "all.png", "two")
    draw_beside_truth(trial, tmp_path / "one.png", "one")
    for name in ("all.png", "one.png"):
        with Image.open(tmp_path / name) as picture:
            assert picture.width > 1.2 * picture.height
            assert len(picture.getcolors(1_000_000) or ()) > 20


def test_a_folder_without_a_trial_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(Refused, match="is no trial that can be read"):
        map_again(tmp_path, load_station(None))


def test_steps_are_a_list_of_numbers() -> None:
    assert step_list("1,2,3") == (1, 2, 3)
    for wrong in ("", "1-3", "12", "1,,2"):
        with pytest.raises(ArgumentTypeError, match="is no list of steps"):
            step_list(wrong)


def test_links_are_a_list_of_known_names() -> None:
    assert link_list("tcp,switch") == ("tcp", "switch")
    for wrong in ("", "wifi", "tcp,tcp"):
        with pytest.raises(ArgumentTypeError, match="is no list of links"):
            link_list(wrong)
