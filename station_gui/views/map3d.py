"""The 3D map: floor from the occupancy grid, outlines of the objects, the robot."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QImage
from PySide6.QtWidgets import QHBoxLayout, QStackedWidget

from station_gui.mapping.snapshot import GridMap, MapSnapshot, ObjectKind
from station_gui.model.view import OperatorView
from station_gui.qt import theme
from station_gui.qt.offscreen_gl import OpenGlError
from station_gui.qt.widgets import Panel, label, overlay_label, tool_button
from station_gui.views import words
from station_gui.views.gl_canvas import GlCanvas
from station_gui.views.grid_picture import Extent
from station_gui.views.pose import footprint_m, robot_on_map

_log = logging.getLogger(__name__)

NO_OPENGL = "3D view needs OpenGL"
_LEGEND = (
    (theme.OBJECT_LARGE, "walls, large"),
    (theme.OBJECT_SMALL, "small"),
    (theme.DISABLED, "2D only"),
    (theme.ROBOT, "robot"),
    (theme.TRAJECTORY, "trail"),
    (theme.PATH, "path"),
)


class Map3dCanvas(Panel):
    """Shows the 3D map; where OpenGL does not work it says so and the window goes on without."""

    def __init__(self) -> None:
        super().__init__("3D map")
        self._snapshot: MapSnapshot | None = None
        self._grid: GridMap | None = None
        self._known: Extent | None = None
        self._path_m: NDArray[np.float64] | None = None
        self._goal_m: tuple[float, float] | None = None
        self._corners_m = np.zeros((0, 2))
        self._stack = QStackedWidget()
        self._apology = label(NO_OPENGL, "sentence", Qt.AlignmentFlag.AlignHCenter)
        self._stack.addWidget(self._apology)
        self._counts = label("", "muted")
        self._scale = label("", "muted")
        self.follow_button = tool_button("Follow", "Keep the robot in the middle", checkable=True)
        self.reset_button = tool_button("Reset view", "Look at the whole map again")
        self.canvas = _make_canvas()
        self._lay_out()
        if self.canvas is not None:
            self._hint = overlay_label(self.canvas)
            self._hint.setText("The 3D map grows here")
            self._stack.addWidget(self.canvas)
            self._stack.setCurrentWidget(self.canvas)
            self.canvas.failed.connect(self._on_failed, Qt.ConnectionType.QueuedConnection)
            self.reset_button.clicked.connect(self._on_reset)

    def show_view(self, view: OperatorView) -> None:
        if self.canvas is None or not self.isVisible():
            return
        if view.snapshot is not self._snapshot:
            self._snapshot = view.snapshot
            self._show_snapshot(self.canvas, view.snapshot)
            self._hint.setVisible(view.snapshot is None)
        if view.path_m is not self._path_m:
            self._path_m = view.path_m
            self.canvas.show_path(view.path_m)
        if view.goal_m != self._goal_m:
            self._goal_m = view.goal_m
            self.canvas.show_goal(view.goal_m)
        self._show_robot(self.canvas, view)

    def picture(self, width_px: int, height_px: int) -> QImage:
        """The 3D scene alone; without OpenGL, the sentence that says so."""
        if self.canvas is not None:
            return self.canvas.picture(width_px, height_px)
        image = QImage(width_px, height_px, QImage.Format.Format_RGB32)
        image.fill(QColor(theme.PANEL))
        return image

    def polish(self) -> None:
        """Draw as finely as can be, for a picture of the window."""
        if self.canvas is not None:
            self.canvas.polish()

    def close_gl(self) -> None:
        """Let go of what OpenGL holds; nothing is drawn after that."""
        if self.canvas is not None:
            self.canvas.close_gl()

    def _lay_out(self) -> None:
        for widget in (self._counts, self.follow_button, self.reset_button):
            self.header.addWidget(widget)
            widget.setEnabled(self.canvas is not None)
        self.body.addWidget(self._stack, 1)
        row = QHBoxLayout()
        row.setSpacing(theme.SPACING_PX)
        for colour, text in _LEGEND:
            row.addWidget(label(f'<span style="color:{colour}">&#9632;</span> {text}', "muted"))
        row.addStretch(1)
        row.addWidget(self._scale)
        self.body.addLayout(row)

    def _show_snapshot(self, canvas: GlCanvas, snapshot: MapSnapshot | None) -> None:
        if snapshot is None:
            self._grid, self._known = None, None
            canvas.forget_map()
            self._counts.setText("")
            return
        if snapshot.grid is not self._grid:
            self._grid = snapshot.grid
            self._frame(canvas, canvas.show_floor(snapshot).known)
            self._scale.setText(f"grid {words.number(canvas.grid_step_m, 1, 'm')}")
        canvas.show_objects(snapshot)
        canvas.show_trail(snapshot)
        small = int(np.count_nonzero(np.asarray(snapshot.objects.kind) == int(ObjectKind.SMALL)))
        self._counts.setText(f"{len(snapshot.objects.kind)} lines, {small} small")

    def _frame(self, canvas: GlCanvas, known: Extent | None) -> None:
        """The view grows with the map until the operator takes the camera."""
        if known != self._known:
            self._known = known
            if not canvas.moved_by_hand and not self.follow_button.isChecked():
                canvas.frame(known)

    def _show_robot(self, canvas: GlCanvas, view: OperatorView) -> None:
        corners = footprint_m(view)
        if not np.array_equal(corners, self._corners_m):
            self._corners_m = corners
            canvas.shape_robot(corners)
        pose = robot_on_map(view)
        canvas.place_robot(pose)
        if pose is not None and self.follow_button.isChecked():
            canvas.look_at(pose)

    def _on_reset(self) -> None:
        self.follow_button.setChecked(False)
        if self.canvas is not None:
            self.canvas.reset_camera(self._known)

    def _on_failed(self) -> None:
        if self.canvas is None:
            return
        self._stack.setCurrentWidget(self._apology)
        self._stack.removeWidget(self.canvas)
        self.close_gl()
        self.canvas.deleteLater()
        self.canvas = None
        for button in (self.follow_button, self.reset_button):
            button.setEnabled(False)


def _make_canvas() -> GlCanvas | None:
    try:
        return GlCanvas()
    except OpenGlError as error:
        _log.warning("no 3D view: %s", error)
        return None
