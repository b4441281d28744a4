"""The live map from above: grid, trajectory, scan, robot, goal."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QPointF, Qt, Signal
from PySide6.QtGui import QImage
from PySide6.QtWidgets import QCheckBox, QHBoxLayout, QSizePolicy, QWidget

from station_gui.mapping.snapshot import MapSnapshot
from station_gui.model.view import LinkState, OperatorView
from station_gui.qt import theme
from station_gui.qt.widgets import Panel, label, overlay_label, picture_of, tool_button
from station_gui.views import words
from station_gui.views.grid_picture import Extent
from station_gui.views.map2d_layers import LAYERS, MapLayers
from station_gui.views.pose import robot_on_map

_FIRST_VIEW = Extent(-1.0, -1.0, 2.0, 2.0)


class Map2dCanvas(Panel):
    """Shows the map and lets the operator point into it: `goal_picked` gives x_m, y_m in the map frame."""

    goal_picked = Signal(float, float)

    def __init__(self) -> None:
        super().__init__("Map")
        self._goal_mode = False
        self._snapshot: MapSnapshot | None = None
        self._plot = _make_plot()
        self.view_box = self._plot.getPlotItem().getViewBox()
        self.layers = MapLayers(self.view_box)
        self._cursor = label("", "muted")
        self.follow_button = tool_button("Follow", "Keep the robot in the middle", checkable=True)
        self.fit_button = tool_button("Fit", "Keep the whole map in view", checkable=True)
        self.fit_button.setChecked(True)
        self._hint = overlay_label(self._plot)
        self._lay_out()
        self._connect()
        self._show_extent(_FIRST_VIEW)

    def set_goal_mode(self, on: bool) -> None:
        """With goal mode on, a left click picks a goal too; a right click always does."""
        self._goal_mode = on
        self._plot.setCursor(Qt.CursorShape.CrossCursor if on else Qt.CursorShape.ArrowCursor)

    def show_view(self, view: OperatorView) -> None:
        self.layers.show_view(view)
        self._show_hint(view)
        if view.snapshot is not self._snapshot:
            self._snapshot = view.snapshot
            self._refit()
        if self.follow_button.isChecked():
            self._centre_on_robot(view)

    def fit(self) -> None:
        """Bring all that is known into view, now and whenever the map grows."""
        self.fit_button.setChecked(True)
        self._refit()

    def picture(self, width_px: int, height_px: int) -> QImage:
        """The plot alone, scaled to this size."""
        return picture_of(self.plot()).scaled(
            width_px, height_px, Qt.AspectRatioMode.KeepAspectRatio, Qt.TransformationMode.SmoothTransformation
        )

    def plot(self) -> QWidget:
        """The widget in which the map is drawn."""
        plot: QWidget = self._plot
        return plot

    def pixel_of(self, x_m: float, y_m: float) -> QPointF:
        """Where this point of the map is in `plot()`."""
        scene = self.view_box.mapViewToScene(QPointF(x_m, y_m))
        return QPointF(self._plot.mapFromScene(scene))

    def _lay_out(self) -> None:
        for widget in (self._cursor, self.follow_button, self.fit_button):
            self.header.addWidget(widget)
        self.body.addWidget(self._plot, 1)
        row = QHBoxLayout()
        row.setSpacing(theme.SPACING_PX)
        for layer in LAYERS:
            box = QCheckBox(layer.title)
            box.setChecked(True)
            box.setToolTip(layer.meaning)
            box.setStyleSheet(f"QCheckBox::indicator:checked {{ background: {layer.colour}; border-color: white; }}")
            box.toggled.connect(lambda on, name=layer.name: self.layers.set_visible(name, on))
            row.addWidget(box)
        row.addStretch(1)
        self.body.addLayout(row)

    def _connect(self) -> None:
        scene = self._plot.scene()
        scene.sigMouseClicked.connect(self._on_click)
        scene.sigMouseMoved.connect(self._on_move)
        self.view_box.sigRangeChangedManually.connect(self._on_moved_by_hand)
        self.fit_button.clicked.connect(self._on_fit)
        self.follow_button.clicked.connect(self._on_follow)

    def _on_fit(self) -> None:
        if self.fit_button.isChecked():
            self.follow_button.setChecked(False)
            self._refit()

    def _on_follow(self) -> None:
        if self.follow_button.isChecked():
            self.fit_button.setChecked(False)

    def _on_moved_by_hand(self) -> None:
        self.fit_button.setChecked(False)
        self.follow_button.setChecked(False)

    def _on_click(self, event: object) -> None:
        button = event.button()  # type: ignore[attr-defined]
        picks = button == Qt.MouseButton.RightButton or (self._goal_mode and button == Qt.MouseButton.LeftButton)
        if not picks or self._snapshot is None or not self._inside(event.scenePos()):  # type: ignore[attr-defined]
            return
        point = self.view_box.mapSceneToView(event.scenePos())  # type: ignore[attr-defined]
        event.accept()  # type: ignore[attr-defined]
        self.goal_picked.emit(float(point.x()), float(point.y()))

    def _on_move(self, scene_position: QPointF) -> None:
        if not self._inside(scene_position):
            self._cursor.setText("")
            return
        point = self.view_box.mapSceneToView(scene_position)
        self._cursor.setText(f"x {words.number(point.x(), 2)}  y {words.number(point.y(), 2, 'm')}")

    def _inside(self, scene_position: QPointF) -> bool:
        return bool(self.view_box.sceneBoundingRect().contains(scene_position))

    def _show_hint(self, view: OperatorView) -> None:
        if view.snapshot is not None:
            self._hint.setVisible(not view.snapshot.located)
            self._hint.setText(words.lost_hint(view.snapshot))
            return
        self._hint.setVisible(True)
        connected = view.link_state is LinkState.CONNECTED
        self._hint.setText("No map yet\nPress Start observation" if connected else "No map yet\nConnect to a robot")

    def _refit(self) -> None:
        if self.fit_button.isChecked() and self.layers.known is not None:
            self._show_extent(self.layers.known)

    def _show_extent(self, extent: Extent) -> None:
        self.view_box.setRange(
            xRange=(extent.left_m, extent.left_m + extent.width_m),
            yRange=(extent.bottom_m, extent.bottom_m + extent.height_m),
            padding=0.06,
        )

    def _centre_on_robot(self, view: OperatorView) -> None:
        pose = robot_on_map(view)
        if pose is None:
            return
        (left, right), (bottom, top) = self.view_box.viewRange()
        half = np.array([right - left, top - bottom]) / 2
        self.view_box.setRange(
            xRange=(pose.x_m - half[0], pose.x_m + half[0]),
            yRange=(pose.y_m - half[1], pose.y_m + half[1]),
            padding=0,
        )


def _make_plot() -> pg.PlotWidget:
    plot = pg.PlotWidget(background=theme.PANEL)
    plot.setMinimumSize(260, 220)
    plot.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
    plot.setFocusPolicy(Qt.FocusPolicy.NoFocus)  # a click on the map must not take the keyboard from the drive pad
    plot.setMenuEnabled(False)
    plot.hideButtons()
    plot.setAspectLocked(True)
    plot.showGrid(x=True, y=True, alpha=0.18)
    plot.getPlotItem().getViewBox().setBackgroundColor(theme.MAP_UNKNOWN)
    for side, text in (("bottom", "x"), ("left", "y")):
        axis = plot.getAxis(side)
        axis.enableAutoSIPrefix(False)
        axis.setPen(theme.BORDER)
        axis.setTextPen(theme.MUTED)
        axis.setLabel(f"{text} (m)", color=theme.MUTED)
        axis.setStyle(maxTickLevel=0)
    plot.getAxis("left").setWidth(52)  # a fixed width: the map does not jump when the numbers grow
    return plot
