"""The operator's station with its window: makes everything, runs it, takes it down in order."""

from __future__ import annotations

import signal
from collections.abc import Callable

from PySide6.QtCore import QTimer

from shared.runtime.clock import MonotonicClock
from shared.runtime.runner import ThreadRunner
from station_gui.build import build_station
from station_gui.comms.target import Target
from station_gui.config import StationConfig
from station_gui.model.station import NameRecording, Station
from station_gui.qt.application import make_application
from station_gui.views.main_window import MainWindow

WhenOpen = Callable[[Station, MainWindow], None]
_SIGNAL_POLL_MS = 200  # Python sees Ctrl-C only when Qt lets it


def run_window(
    config: StationConfig,
    first_command: int,
    connect_to: Target | None = None,
    when_open: WhenOpen | None = None,
    name_recording: NameRecording | None = None,
) -> int:
    """Show the window until it is closed; `when_open` is called once it stands. Returns Qt's exit code."""
    application = make_application(["station-gui"])
    clock = MonotonicClock()
    station = build_station(config, clock, first_command, name_recording=name_recording)
    runner = ThreadRunner(station.tasks(), clock, station.on_fault)
    window = MainWindow(station, config.window, config.radio.ports)
    signal.signal(signal.SIGINT, lambda *_: window.close())
    signal.signal(signal.SIGTERM, lambda *_: window.close())
    waker = QTimer()
    waker.timeout.connect(lambda: None)
    waker.start(_SIGNAL_POLL_MS)
    runner.start()
    try:
        window.show()
        if connect_to is not None:
            station.connect(connect_to.host, connect_to.port, connect_to.radio_ports)
        if when_open is not None:
            when_open(station, window)
        return int(application.exec())
    finally:
        runner.stop()
        station.close()
        window.close()
