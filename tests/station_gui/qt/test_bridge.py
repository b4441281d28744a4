"""An exception at the boundary is logged, and nothing else happens."""

import logging
import sys

import pytest
from PySide6.QtCore import QTimer

from station_gui.qt.bridge import Guard, install_exception_hook, log_exception


def fail():
    raise ValueError("broken")


def test_a_guard_logs_the_begin_and_the_end_of_a_fault(caplog):
    guard = Guard("the map")
    with caplog.at_level(logging.INFO):
        for action in (fail, fail, int, int, fail):
            guard.run(action)
    assert [record.getMessage() for record in caplog.records] == [
        "the map cannot be drawn",
        "the map is drawn again",
        "the map cannot be drawn",
    ]
    assert caplog.records[0].exc_info is not None
    assert guard.faulty


def test_a_fault_in_a_slot_is_logged_with_its_traceback(qapp, caplog, monkeypatch):
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)
    install_exception_hook()
    timer = QTimer()
    timer.timeout.connect(fail)
    timer.timeout.emit()
    assert "unexpected fault in the window" in caplog.text
    assert "ValueError: broken" in caplog.text


def test_an_interrupt_from_the_keyboard_is_not_a_fault(caplog, monkeypatch):
    passed_on = []
    monkeypatch.setattr(sys, "__excepthook__", lambda *args: passed_on.append(args[0]))
    log_exception(KeyboardInterrupt, KeyboardInterrupt(), None)
    assert passed_on == [KeyboardInterrupt]
    assert not caplog.records


def test_a_guard_does_not_hold_an_interrupt_back():
    def interrupt():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Guard("the map").run(interrupt)
