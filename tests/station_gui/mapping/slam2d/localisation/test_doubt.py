from __future__ import annotations

import numpy as np
import pytest

from shared.geometry.se2 import Pose2
from station_gui.mapping.slam2d.localisation.config import DoubtConfig
from station_gui.mapping.slam2d.localisation.doubt import Wariness

_STILL = Pose2()


@pytest.fixture
def wariness() -> Wariness:
    made = Wariness(DoubtConfig())
    for _ in range(100):
        made.note(0.97, 0.5, _STILL)
    return made


def test_a_scan_that_fits_as_usual_enters_the_map(wariness: Wariness) -> None:
    assert wariness.admits(0.95, 1.0)
    assert not wariness.wary


def test_what_fits_worse_than_usual_stays_out_and_so_does_what_comes_next(wariness: Wariness) -> None:
    assert not wariness.admits(0.85, 1.0)
    wariness.note(0.85, 1.0, _STILL)
    assert not wariness.admits(0.97, 0.5)
    assert not wariness.lasting


def test_some_scans_that_fit_end_it(wariness: Wariness) -> None:
    wariness.note(0.85, 1.0, _STILL)
    for _ in range(3):
        assert wariness.wary
        wariness.note(0.97, 0.5, _STILL)
    assert not wariness.wary
    assert wariness.admits(0.97, 0.5)


def test_scans_that_go_on_fitting_worse_are_reason_to_doubt(wariness: Wariness) -> None:
    for _ in range(3):
        assert not wariness.lasting
        wariness.note(0.85, 1.0, _STILL)
    assert wariness.lasting


def test_a_jump_is_doubted_at_once_however_well_it_fits(wariness: Wariness) -> None:
    assert not wariness.admits(1.0, 30.0)
    wariness.note(1.0, 30.0, _STILL)
    assert wariness.lasting
    for _ in range(10):
        wariness.note(1.0, 0.1, _STILL)
    assert wariness.lasting


def test_who_drives_on_sees_new_things(wariness: Wariness) -> None:
    for _ in range(6):
        wariness.note(0.85, 1.0, Pose2(0.1, 0.0, 0.0))
    assert not wariness.wary
    assert wariness.admits(0.85, 1.0)


def test_after_an_unfounded_doubt_the_fit_is_not_doubted_for_a_while(wariness: Wariness) -> None:
    wariness.note(0.85, 1.0, _STILL)
    wariness.accept(0.85)
    assert wariness.admits(0.7, 1.0)
    assert not wariness.admits(0.7, 12.0)
    for _ in range(DoubtConfig().rest_scans):
        wariness.note(float(np.float32(0.85)), 1.0, _STILL)
    assert not wariness.admits(0.7, 1.0)


def test_the_usual_fit_follows_the_place(wariness: Wariness) -> None:
    for fit in np.linspace(0.97, 0.8, 200):
        wariness.note(float(fit), 0.5, _STILL)
        assert not wariness.wary
    assert wariness.admits(0.79, 0.5)
