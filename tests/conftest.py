"""Fixtures for all tests: nothing may leave a thread behind, and every generator has a seed."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import numpy as np
import pytest

_PATIENCE_S = 5.0


@pytest.fixture(autouse=True)
def _no_thread_is_left_behind() -> Iterator[None]:
    before = set(threading.enumerate())
    yield
    left = [t for t in threading.enumerate() if t not in before and not isinstance(t, threading._DummyThread)]
    for thread in left:
        thread.join(_PATIENCE_S)
    still = [t.name for t in left if t.is_alive()]
    assert not still, f"threads left behind: {still}"


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20231122)
