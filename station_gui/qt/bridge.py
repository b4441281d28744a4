"""The boundary between Qt and the rest: an exception in a slot is logged, and the window lives on."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable
from types import TracebackType

_log = logging.getLogger(__name__)


def install_exception_hook() -> None:
    """Log what escapes from slots and event handlers; PySide hands it to `sys.excepthook` and goes on."""
    sys.excepthook = log_exception


def log_exception(kind: type[BaseException], error: BaseException, traceback: TracebackType | None) -> None:
    if issubclass(kind, KeyboardInterrupt):
        sys.__excepthook__(kind, error, traceback)
        return
    _log.error("unexpected fault in the window", exc_info=(kind, error, traceback))


class Guard:
    """Runs one part of a refresh so that its failure does not take the other parts with it.

    A fault is logged when it begins, with its traceback, and when it ends; not at every tick in between.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._faulty = False

    @property
    def faulty(self) -> bool:
        return self._faulty

    def run(self, action: Callable[[], None]) -> None:
        try:
            action()
        except Exception:  # noqa: BLE001 - the slot boundary: one part's fault must not stop the others
            if not self._faulty:
                _log.exception("%s cannot be drawn", self._name)
            self._faulty = True
            return
        if self._faulty:
            _log.info("%s is drawn again", self._name)
        self._faulty = False
