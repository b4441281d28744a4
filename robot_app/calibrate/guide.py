"""The talk with the operator: what to do, when it is done, and whether anything may move."""

from __future__ import annotations

import math
import os
import select
import sys
import termios
from collections.abc import Callable
from typing import Protocol

from shared.runtime.clock import Clock

_ANSWER_WITHIN_S = 300.0
_LOOK_EVERY_S = 0.01
_LONGEST_LINE = 4096


class CalibrationError(Exception):
    """The measurement cannot be made or is worth nothing; the text says why, and what to do."""


class Guide(Protocol):
    def say(self, text: str) -> None: ...

    def agree(self, question: str) -> bool:
        """True for the word yes alone."""
        ...

    def number(self, question: str, low: float, high: float) -> float: ...

    def until_enter(self, text: str, meanwhile: Callable[[], None]) -> None:
        """Call `meanwhile` again and again until the operator presses Enter."""
        ...


def nothing() -> None:
    """Where there is nothing to do meanwhile."""


class Terminal:
    """Raises `CalibrationError` when nobody answers for five minutes, or when the terminal is gone."""

    def __init__(self, clock: Clock, answer_within_s: float = _ANSWER_WITHIN_S) -> None:
        self._clock = clock
        self._answer_within_s = answer_within_s
        self._fd = sys.stdin.fileno()
        self._typed = b""

    def say(self, text: str) -> None:
        print(text, flush=True)  # noqa: T201 - the command's own words

    def agree(self, question: str) -> bool:
        return self._ask(f"{question} Type yes to go on: ").lower() == "yes"

    def number(self, question: str, low: float, high: float) -> float:
        while True:
            try:
                value = float(self._ask(f"{question} ({low:g} to {high:g}): ").replace(",", "."))
            except ValueError:
                value = math.nan
            if low <= value <= high:
                return value
            self.say(f"A number from {low:g} to {high:g}, please.")

    def until_enter(self, text: str, meanwhile: Callable[[], None]) -> None:
        self._ask(f"{text}, then press Enter: ", meanwhile)

    def _ask(self, prompt: str, meanwhile: Callable[[], None] = nothing) -> str:
        self._forget_typed()
        print(prompt, end="", flush=True)  # noqa: T201
        due_s = self._clock.now_s() + self._answer_within_s
        while b"\n" not in self._typed:
            if self._clock.now_s() > due_s:
                raise CalibrationError("nobody answered; nothing was changed")
            meanwhile()
            if select.select([self._fd], [], [], _LOOK_EVERY_S)[0]:
                data = os.read(self._fd, _LONGEST_LINE)
                if not data:
                    raise CalibrationError("there is nobody at the terminal; nothing was changed")
                self._typed = (self._typed + data)[-_LONGEST_LINE:]
        line, _, self._typed = self._typed.partition(b"\n")
        return line.decode("utf-8", "replace").strip()

    def _forget_typed(self) -> None:
        """An answer is one to the question: what was typed before it does not count."""
        if os.isatty(self._fd):
            termios.tcflush(self._fd, termios.TCIFLUSH)
            self._typed = b""
