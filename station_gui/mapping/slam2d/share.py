"""Long work done a bounded share at a time, in the caller's thread."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")
Task = Iterator[None]  # does one share of its work whenever it is advanced


class Share:
    """Units of work that are left in the present step; `done` counts those of all steps."""

    def __init__(self, units: int = 0) -> None:
        self.left = units
        self.done = 0

    def begin(self, units: int) -> None:
        self.left = units

    def take(self, units: int) -> None:
        self.left -= units
        self.done += units

    def run(self, task: Task, units: int) -> bool:
        """One share of `task`; True when it has come to its end."""
        self.begin(units)
        return next(task, _END) is _END

    def spread(self, kernel: Callable[[NDArray[np.int64], int], int], state: NDArray[np.int64], end: int) -> Task:
        """`kernel` takes its state and a budget and returns what it used, until `state[0]` has come to `end`."""
        while state[0] < end:
            if self.left <= 0:
                yield
            self.take(kernel(state, self.left))


def at_once(make_task: Callable[[Share], Iterator[object]]) -> None:
    """The whole of a task, without a pause."""
    for _ in make_task(Share(_PLENTY)):
        pass


def result_at_once(make_task: Callable[[Share], Generator[None, None, T]]) -> T:
    """What a task comes to, without a pause."""
    task = make_task(Share(_PLENTY))
    while True:
        try:
            next(task)
        except StopIteration as end:
            return cast("T", end.value)


_END = object()
_PLENTY = 1 << 60
