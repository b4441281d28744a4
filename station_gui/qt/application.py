"""Making the QApplication."""

from __future__ import annotations

from PySide6.QtCore import QCoreApplication, Qt
from PySide6.QtGui import QSurfaceFormat
from PySide6.QtWidgets import QApplication

from station_gui.qt.bridge import install_exception_hook
from station_gui.qt.theme import apply_theme


def prepare_opengl() -> None:
    """Must come before the QApplication.

    pyqtgraph keeps its shader programs for the whole process, so all contexts have to share theirs.
    """
    QCoreApplication.setAttribute(Qt.ApplicationAttribute.AA_ShareOpenGLContexts)
    surface_format = QSurfaceFormat()
    surface_format.setDepthBufferSize(24)
    QSurfaceFormat.setDefaultFormat(surface_format)


def make_application(arguments: list[str]) -> QApplication:
    """The application with theme and exception hook; takes what Qt understands from `arguments`."""
    prepare_opengl()
    application = QApplication(arguments)
    application.setApplicationName("station-gui")
    apply_theme(application)
    install_exception_hook()
    return application
