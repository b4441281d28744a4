"""Saving the map to a file, opening one, exporting it for other programs: a menu and the dialogs behind it.

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


class MapFileMenu(QWidget):
    """Emits `save_asked` with a path, `export_asked` with a folder, or `open_asked` with a path and whether the robot
    shall only localise in it."""

    save_asked = Signal(str)
    export_asked = Signal(str)
    open_asked = Signal(str, bool)

    def __init__(self) -> None:
        super().__init__()
        self.button = tool_button("File", "Open, save and export maps")
        self.button.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        menu = QMenu(self.button)
        menu.setToolTipsVisible(True)
        self.button.setMenu(menu)
        self.continue_action = _action(
            menu, "Open map and continue mapping…", "The robot is looked for in the map, which then goes on growing"
        )
        self.localise_action = _action(
            menu, "Open map and only localise…", "The robot is looked for and followed; the map stays as it is"
        )
        menu.addSeparator()
        self.save_action = _action(menu, "Save map…", "Write the map to a file")
        self.export_action = _action(
            menu,
            "Export map…",
            "Write the map into a folder for other programs: PLY, glTF, Nav2, PNG and the way as TUM",
        )
        self.dialog: QFileDialog | None = None
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(self.button)
        self.save_action.triggered.connect(self._on_save)
        self.export_action.triggered.connect(self._on_export)
        self.continue_action.triggered.connect(lambda: self._on_open(False))
        self.localise_action.triggered.connect(lambda: self._on_open(True))

    def show_view(self, view: OperatorView) -> None:
        is_map = view.snapshot is not None and len(view.snapshot.trajectory) > 0
        self.save_action.setEnabled(is_map)
        self.export_action.setEnabled(is_map)

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


def _action(menu: QMenu, text: str, tip: str) -> QAction:
    action = QAction(text, menu)
    action.setToolTip(tip)
    menu.addAction(action)
    return action
