"""Talks with a module that is being configured, sans-I/O.

A procedure is a generator: it yields what to do and is given what came of it. `Dialogue` runs one on bytes and a
clock. The driver and the command-line tool run the same procedures.
"""

from __future__ import annotations

import re
from collections.abc import Generator
from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar

from shared.link.es920lr.parser import MODE_QUESTION

T = TypeVar("T")
_MOST_BYTES = 4_096  # `show` is 700


class DialogueError(Exception):
    """The module cannot be brought to do it; the text says what to do."""


class Wait(Enum):
    """What ends an answer."""

    REPLY = "OK or NG"
    SHOW = "the empty line after the settings"
    VERSION = "VER"
    QUIET = "nothing more is coming"


@dataclass(frozen=True, slots=True)
class Ask:
    data: bytes
    wait: Wait
    timeout_s: float


@dataclass(frozen=True, slots=True)
class SetBaudRate:
    """Speak at this rate from now on."""

    baud_rate: int


@dataclass(frozen=True, slots=True)
class ResetModule:
    """Pulse the reset pin."""


Step = Ask | SetBaudRate | ResetModule


class Said(Enum):
    OK = "OK"
    REFUSED = "NG"
    BINARY = "a reply in binary"  # only a module in operation speaks so
    MODE_QUESTION = "Select Mode"
    PROMPT = "LORA >"  # the configuration for people
    TEXT = "text"
    NOTHING = "nothing"


@dataclass(frozen=True, slots=True)
class Answer:
    said: Said
    text: str = ""
    refusal: int = 0


Procedure = Generator[Step, Answer, T]
DONE = Answer(Said.NOTHING)  # to a step that gets no answer

_REPLY = re.compile(rb"(?P<binary>\x06NG \d{3}|\x02OK)(?![\r\d])|(?<![!-~])(?:OK|NG (?P<refusal>\d{3}))\r\n")
_VERSION = re.compile(rb"(VER [ -~]+)\r\n")
_SHOW_END = re.compile(rb"Send Data +:[^\r\n]*\r\n(?:[^\r\n]+\r\n)*\r\n")
_PROMPT = b"LORA > "


class Dialogue(Generic[T]):
    """Runs one procedure. Take `steps` after making it and after each call, and carry them out in order."""

    def __init__(self, procedure: Procedure[T], now_s: float) -> None:
        self._procedure = procedure
        self._heard = bytearray()
        self._waiting: Ask | None = None
        self._deadline_s = now_s
        self._result: list[T] = []
        self.steps: list[Step] = []
        self._advance(None, now_s)

    @property
    def finished(self) -> bool:
        return bool(self._result)

    @property
    def result(self) -> T:
        """What the procedure returned; ask only when it has finished."""
        return self._result[0]

    @property
    def deadline_s(self) -> float:
        """The time by which `tick` must be called."""
        return self._deadline_s

    def feed(self, data: bytes, now_s: float) -> None:
        """Raises `DialogueError` when the procedure gives up."""
        if self._waiting is None or not data:
            return
        self._heard += data
        del self._heard[:-_MOST_BYTES]
        answer = _complete(bytes(self._heard), self._waiting.wait)
        if answer is not None:
            self._advance(answer, now_s)

    def tick(self, now_s: float) -> None:
        """Raises `DialogueError` when the procedure gives up."""
        if self._waiting is not None and now_s >= self._deadline_s:
            self._advance(_late(bytes(self._heard)), now_s)

    def _advance(self, answer: Answer | None, now_s: float) -> None:
        self._heard.clear()
        self._waiting = None
        while not self._result:
            try:
                step = next(self._procedure) if answer is None else self._procedure.send(answer)
            except StopIteration as stop:
                self._result.append(stop.value)
                return
            self.steps.append(step)
            if isinstance(step, Ask):
                self._waiting = step
                self._deadline_s = now_s + step.timeout_s
                return
            answer = DONE


def _complete(heard: bytes, wait: Wait) -> Answer | None:
    """The answer, when `heard` holds all of it."""
    if wait is Wait.QUIET:
        return None
    if MODE_QUESTION in heard:
        return Answer(Said.MODE_QUESTION)
    if (end := _SHOW_END.search(heard)) and wait is Wait.SHOW:
        return Answer(Said.TEXT, _text(heard[: end.end()]))
    if (version := _VERSION.search(heard)) and wait is Wait.VERSION:
        return Answer(Said.TEXT, _text(version[1]))
    return _reply(heard)


def _reply(heard: bytes) -> Answer | None:
    match = _REPLY.search(heard)
    if match is None:
        return None
    if match["binary"] is not None:
        return Answer(Said.BINARY)
    if match["refusal"] is not None:
        return Answer(Said.REFUSED, refusal=int(match["refusal"]))
    return Answer(Said.OK)


def _late(heard: bytes) -> Answer:
    """What to make of an answer that has not ended as it should."""
    answer = _complete(heard, Wait.REPLY)
    if answer is not None:
        return answer
    if _PROMPT in heard:
        return Answer(Said.PROMPT)
    return Answer(Said.TEXT, _text(heard)) if heard else Answer(Said.NOTHING)


def _text(heard: bytes) -> str:
    return heard.decode("ascii", "replace")
