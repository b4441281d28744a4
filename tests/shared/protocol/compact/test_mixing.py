from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from shared.protocol.compact.model import Coding, Model

_SIZE = 1 << 16


def writing() -> Coding:
    return Coding(Model.untrained(), np.zeros(_SIZE, np.uint8), _SIZE, reading=False)


def reading(data: bytes) -> Coding:
    array = np.frombuffer(data, np.uint8).copy()
    return Coding(Model.untrained(), array, len(array), reading=True)


@given(st.lists(st.tuples(st.integers(-(2**30), 2**30), st.integers(0, 10)), max_size=60))
def test_numbers_come_back_as_they_were_written(values: list[tuple[int, int]]) -> None:
    coding = writing()
    for value, kind in values:
        coding.number(value, kind, 32, a=kind % 3)
    data = coding.finish()
    back = reading(data)
    assert [back.number(0, kind, 32, a=kind % 3) for _, kind in values] == [value for value, _ in values]
    assert back.has_ended()


def test_what_is_longer_than_what_was_written_is_noticed(rng: np.random.Generator) -> None:
    values = np.round(rng.normal(0, 9, 50)).astype(int).tolist()
    coding = writing()
    for value in values:
        coding.number(value, 2, 12)
    data = coding.finish()
    for other in (data + b"\0", data + b"\0\0", data + b"\x01\x02\x03"):
        back = reading(other)
        for _ in values:
            back.number(0, 2, 12)
        assert not back.has_ended()


def test_what_is_expected_costs_next_to_nothing() -> None:
    coding = writing()
    for _ in range(2_000):
        coding.number(0, 3, 16)
    assert len(coding.finish()) < 25


def test_noise_costs_what_its_entropy_says(rng: np.random.Generator) -> None:
    values = np.round(rng.normal(0, 2, 6_000)).astype(int).tolist()
    coding = writing()
    for value in values:
        coding.number(value, 4, 16)
    counts = np.unique(values, return_counts=True)[1] / len(values)
    floor = -(counts * np.log2(counts)).sum() * len(values) / 8
    assert floor < len(coding.finish()) < 1.04 * floor


@given(st.binary(max_size=300))
def test_any_bytes_give_some_numbers(data: bytes) -> None:
    coding = reading(data)
    for kind in range(30):
        assert abs(coding.number(0, kind, 12)) < 4096
