from __future__ import annotations

import os

import pytest

from tools.evaluate.endurance.command import Sample, growth_mb, row_figures, sample_of


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


def test_a_process_is_sampled() -> None:
    sample = sample_of(os.getpid(), 1.0)
    assert sample.memory_mb > 1.0
    assert sample.processor_s > 0.0
