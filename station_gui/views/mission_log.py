"""What happened, newest at the bottom."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QStandardItem, QStandardItemModel
from PySide6.QtWidgets import QAbstractItemView, QListView

from station_gui.model.view import LogEntry, Operator, Severity
from station_gui.qt import theme
from station_gui.qt.widgets import Panel

_COLOURS = {Severity.INFO: theme.TEXT, Severity.WARNING: theme.WARNING, Severity.ERROR: theme.BAD}


class MissionLog(Panel):
    """Keeps the last `max_lines` entries."""

    def __init__(self, max_lines: int) -> None:
        super().__init__("Mission log")
        self._max_lines = max_lines
        self._seen = 0
        self.model = QStandardItemModel(0, 1, self)
        self.list = QListView()
        self.list.setModel(self.model)
        self.list.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.list.setSelectionMode(QAbstractItemView.SelectionMode.NoSelection)
        self.list.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.list.setWordWrap(True)
        self.list.setMinimumHeight(60)
        self.list.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.body.addWidget(self.list, 1)

    def show_log(self, operator: Operator, length: int) -> None:
        """Append what is new; `length` is how many entries there have been."""
        if length == self._seen:
            return
        if length < self._seen:
            self.model.clear()
            self._seen = 0
        entries = operator.log_since(self._seen)[-self._max_lines :]
        self._seen = length
        bar = self.list.verticalScrollBar()
        at_end = bar.value() >= bar.maximum() - 4
        for entry in entries:
            self.model.appendRow(_item(entry))
        self.model.removeRows(0, max(0, self.model.rowCount() - self._max_lines))
        if at_end:
            self.list.scrollToBottom()


def _item(entry: LogEntry) -> QStandardItem:
    minutes, seconds = divmod(max(0.0, entry.time_s), 60)
    item = QStandardItem(f"{int(minutes):02d}:{seconds:04.1f}  {entry.text}")
    item.setForeground(QColor(_COLOURS.get(entry.severity, theme.TEXT)))
    item.setToolTip(entry.text)
    return item
