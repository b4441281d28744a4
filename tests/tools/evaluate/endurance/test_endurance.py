from __future__ import annotations

import os
from argparse import Namespace

import pytest

from shared.config import ConfigError
from tools.evaluate.endurance.command import Sample, _result, growth_mb, row_figures, run, sample_of


def test_memory_counts_after_the_first_minute() -> None:
    samples = [Sample(i, 100.0 + min(i, 60) + 0.01 * max(0, i - 60), 0.0) for i in range(160)]
    assert growth_mb(samples) == pytest.approx(0.9)
    assert growth_mb(samples[:70]) is None


def test_a_row_is_told_in_shares_and_milliseconds() -> None:
    row = {
        "rate_hz": 100.0,
        "ticks": 990.0,
        "late": 2,
        "latest_s": 0.0123,
        "over_budget": 1,
        "longest_s": 0.003,
        "busy_s": 0.5,
    }
    figures = row_figures("odometry", row, 10.0)
    assert (figures.rate_share, figures.late_share, figures.latest_ms) == (0.99, 0.00202, 12.3)
    assert (figures.longest_ms, figures.cores) == (3.0, 0.05)


def test_it_says_which_limit_was_missed() -> None:
    row = {"rate_hz": 100.0, "ticks": 990.0, "late": 100, "latest_s": 0.01, "over_budget": 0, "longest_s": 0.003}
    measured = {"ran_s": 10.0, "rows": {"odometry": {**row, "busy_s": 0.5}}, "nice": 0, "simulator": {}}
    result = _result(measured, [Sample(0.0, 100.0, 0.0), Sample(10.0, 100.0, 2.0)])  # type: ignore[arg-type]
    assert not result["kept"]
    assert result["missed"] == ["0.1010 of the 100 Hz ticks were late: under 0.005 is wanted"]


def test_a_scenario_that_there_is_not_is_refused_before_anything_starts() -> None:
    with pytest.raises(ConfigError, match="no scenario 'foo'"):
        run(Namespace(scenario="foo"))


def test_a_process_is_sampled() -> None:
    sample = sample_of(os.getpid(), 1.0)
    assert sample.memory_mb > 1.0
    assert sample.processor_s > 0.0
