"""Saving the map to a file, opening one, exporting it for other programs: buttons and the dialogs behind them.

The dialogs hold up nothing: the window goes on looking at the robot, and the emergency stop works beside them.
"""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QFileDialog, QHBoxLayout, QMenu, QToolButton, QWidget

from station_gui.mapping.saved_map import SUFFIX
from station_gui.model.view import OperatorView
from station_gui.qt.widgets import tool_button

_FILTER = f"Maps (*{SUFFIX});;All files (*)"


class MapFileButtons(QWidget):
    """Emits `save_asked` with a path, `export_asked` with a folder, or `open_asked` with a path and whether the robot
    shall only localise in it."""

    save_asked = Signal(str)
    export_asked = Signal(str)
    open_asked = Signal(str, bool)

    def __init__(self) -> None:
        super().__init__()
        self.save_button = tool_button("Save map…", "Write the map to a file")
        self.export_button = tool_button(
            "Export…", "Write the map into a folder for other programs: PLY, glTF, Nav2, PNG and the way as TUM"
        )
        self.open_button = tool_button("Open map…", "Begin with a map from a file; the present one is forgotten")
        self.open_button.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        self.continue_action = QAction("and continue mapping…", self)
        self.continue_action.setToolTip("The robot is looked for in the map, which then goes on growing")
        self.localise_action = QAction("and only localise…", self)
        self.localise_action.setToolTip("The robot is looked for and followed; the map stays as it is")
        menu = QMenu(self.open_button)
        menu.setToolTipsVisible(True)
        menu.addActions([self.continue_action, self.localise_action])
        self.open_button.setMenu(menu)
        self.dialog: QFileDialog | None = None
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(self.open_button)
        row.addWidget(self.save_button)
        row.addWidget(self.export_button)
        self.save_button.clicked.connect(self._on_save)
        self.export_button.clicked.connect(self._on_export)
        self.continue_action.triggered.connect(lambda: self._on_open(False))
        self.localise_action.triggered.connect(lambda: self._on_open(True))

    def show_view(self, view: OperatorView) -> None:
        is_map = view.snapshot is not None and len(view.snapshot.trajectory) > 0
        self.save_button.setEnabled(is_map)
        self.export_button.setEnabled(is_map)

    def close_dialog(self) -> None:
        if self.dialog is not None:
            self.dialog.reject()

    def _on_save(self) -> None:
        dialog = self._make_dialog("Save map", QFileDialog.AcceptMode.AcceptSave, QFileDialog.FileMode.AnyFile)
        dialog.setDefaultSuffix(SUFFIX.removeprefix("."))
        dialog.selectFile(f"map{SUFFIX}")
        dialog.fileSelected.connect(self.save_asked)
        dialog.show()

    def _on_export(self) -> None:
        accept, mode = QFileDialog.AcceptMode.AcceptOpen, QFileDialog.FileMode.Directory
        dialog = self._make_dialog("Export map into a folder", accept, mode)
        dialog.setOption(QFileDialog.Option.ShowDirsOnly)
        dialog.fileSelected.connect(self.export_asked)
        dialog.show()

    def _on_open(self, localise: bool) -> None:
        title = "Open map and only localise" if localise else "Open map and continue mapping"
        dialog = self._make_dialog(title, QFileDialog.AcceptMode.AcceptOpen, QFileDialog.FileMode.ExistingFile)
        dialog.fileSelected.connect(lambda path: self.open_asked.emit(path, localise))
        dialog.show()

    def _make_dialog(self, title: str, accept: QFileDialog.AcceptMode, mode: QFileDialog.FileMode) -> QFileDialog:
        """Not the system's own: that one may hold up the window."""
        self.close_dialog()
        dialog = QFileDialog(self, title, str(Path.cwd()), _FILTER)
        dialog.setOption(QFileDialog.Option.DontUseNativeDialog)
        dialog.setWindowModality(Qt.WindowModality.NonModal)
        dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        dialog.setAcceptMode(accept)
        dialog.setFileMode(mode)
        dialog.finished.connect(self._on_finished)
        self.dialog = dialog
        return dialog

    def _on_finished(self) -> None:
        self.dialog = None
