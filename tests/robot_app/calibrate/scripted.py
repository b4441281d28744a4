"""An operator who does what the test says."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

Action = Callable[[Callable[[], None]], None]


class Operator:
    """Does one of `actions` at each Enter, and answers as told; what was said is kept."""

    def __init__(self, *actions: Action, numbers: tuple[float, ...] = (), agrees: bool = True) -> None:
        self._actions: Iterator[Action] = iter(actions)
        self._numbers = iter(numbers)
        self._agrees = agrees
        self.heard: list[str] = []

    def say(self, text: str) -> None:
        self.heard.append(text)

    def agree(self, question: str) -> bool:
        self.heard.append(question)
        return self._agrees

    def number(self, question: str, low: float, high: float) -> float:
        value = next(self._numbers)
        assert low <= value <= high
        return value

    def until_enter(self, text: str, meanwhile: Callable[[], None]) -> None:
        self.heard.append(text)
        next(self._actions, lambda _: None)(meanwhile)


def values(changes: list[Any]) -> dict[str, Any]:
    return {change.key.rpartition(".")[2]: change.after for change in changes}
