"""Short runs of `python -m tools.fuzz`; the long ones are for the command line. The firmware has its own tests."""

from __future__ import annotations

import numpy as np
import pytest

from tools.fuzz.base import MOST_GROWTH_BYTES, Outcome, Verdict, fuzz
from tools.fuzz.targets import TARGETS, fuzz_apart

_WITHOUT_FIRMWARE = [name for name in TARGETS if name not in {"core", "hex"}]


class _Leak:
    """Takes what nobody said, and keeps it all."""

    def __init__(self) -> None:
        self.kept: list[bytes] = []

    def throw(self) -> int:
        self.kept.append(bytes([len(self.kept) % 256]) * 100_000)
        return 100_000

    def verdict(self) -> Verdict:
        return Verdict(len(self.kept), len(self.kept), 0, 0)


@pytest.mark.parametrize("name", _WITHOUT_FIRMWARE)
def test_foreign_bytes_are_neither_believed_nor_harmful(name: str, rng: np.random.Generator) -> None:
    outcome = fuzz(TARGETS[name].make(rng), 60_000)
    assert outcome.verdict.foreign > 10
    assert outcome.verdict.forgeries == outcome.verdict.refused == 0


def test_growth_is_noticed_and_so_are_forgeries() -> None:
    outcome = fuzz(_Leak(), 20_000_000)
    assert outcome.grown_bytes > MOST_GROWTH_BYTES
    assert not outcome.passed


def test_a_target_in_its_own_process_tells_how_far_it_is() -> None:
    told: list[int] = []
    outcome = fuzz_apart("items", 20_000, 1, told.append)
    assert isinstance(outcome, Outcome)
    assert outcome.passed
    assert told
    assert told[-1] >= 20_000
