from __future__ import annotations

import argparse

import pytest

from tools.evaluate.seeds import header, over_seeds, row, seed_list

RUNS: dict[int, dict[str, float | int | str | bool | None]] = {
    1: {"pose_rmse_m": 0.002, "map_completeness": 0.95, "encoder_slip_net": -0.06, "goal_error_m": None},
    2: {"pose_rmse_m": 0.004, "map_completeness": 0.93, "encoder_slip_net": 0.05, "goal_error_m": 0.1},
}
RUNS[1]["finished"], RUNS[2]["finished"] = True, False


def test_seeds_are_a_list_of_ranges() -> None:
    assert seed_list("1-3,7") == (1, 2, 3, 7)


@pytest.mark.parametrize("text", ["", "x", "3-1", "1,1-2", "-2", "1-", "0-99999999"])
def test_what_is_no_list_of_seeds_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError):
        seed_list(text)


def test_the_worst_is_the_largest_error_and_the_smallest_completeness() -> None:
    summary = over_seeds(RUNS)
    assert summary["worst"] == {"pose_rmse_m": 0.004, "map_completeness": 0.93, "encoder_slip_net": -0.06}
    assert summary["mean"]["pose_rmse_m"] == pytest.approx(0.003)
    assert summary["seeds"] == [1, 2]
    assert summary["runs"][1]["seed"] == 2
    assert not summary["finished"]


def test_rows_stand_under_their_header() -> None:
    assert len(row("1", RUNS[1])) == len(header())
    assert row("mean", over_seeds(RUNS)["mean"]).split()[:2] == ["mean", "0.0030"]
