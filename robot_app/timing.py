"""How well the schedule was kept, for the log when the app ends."""

from __future__ import annotations

import resource
from collections.abc import Iterator, Sequence

from shared.runtime.runner import LATE_S, TaskHealth


def timing_report(health: Sequence[TaskHealth], ran_s: float) -> Iterator[str]:
    """A line for the process since its start, and one for each task that was called. Empty when nothing ran."""
    if ran_s <= 0:
        return
    used = resource.getrusage(resource.RUSAGE_SELF)
    yield (
        f"ran for {ran_s:.0f} s; the process took {used.ru_utime + used.ru_stime:.0f} s of processor time "
        f"and at most {used.ru_maxrss / 1024:.0f} MB since it began"
    )
    for h in health:
        if h.ticks:
            yield (
                f"{h.row.name}: {h.ticks / ran_s:.1f} of {h.row.rate_hz:g} Hz, "
                f"{h.late / h.ticks:.2%} late by more than {LATE_S * 1e3:g} ms, at most {h.latest_s * 1e3:.1f} ms; "
                f"{h.over_budget / h.ticks:.2%} over {h.row.budget_s * 1e3:g} ms, at most {h.longest_s * 1e3:.1f} ms"
            )
