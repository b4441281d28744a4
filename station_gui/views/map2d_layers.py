"""What is drawn on the map from above; each layer redraws only when what it shows has changed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, auto

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRectF
from PySide6.QtGui import QBrush, QColor, QPen, QPolygonF
from PySide6.QtWidgets import QGraphicsPolygonItem

from shared.messages import Observation
from station_gui.mapping.snapshot import GridMap, MapSnapshot
from station_gui.model.view import OperatorView
from station_gui.qt import theme
from station_gui.views.grid_picture import Extent, colour_table, make_picture
from station_gui.views.pose import finite_rows, footprint_m, robot_on_map, scan_on_map_m


class LayerName(Enum):
    GRID = auto()
    TRAJECTORY = auto()
    CLOSURES = auto()
    SCAN = auto()
    PATH = auto()
    ROBOT = auto()


@dataclass(frozen=True, slots=True)
class Layer:
    name: LayerName
    title: str
    meaning: str
    colour: str


LAYERS = (
    Layer(LayerName.GRID, "Grid", "White is free, dark is occupied, grey is unknown", theme.MAP_UNKNOWN),
    Layer(LayerName.TRAJECTORY, "Trail", "Where the keyframes were made", theme.TRAJECTORY),
    Layer(LayerName.CLOSURES, "Loops", "Places that were recognised again", theme.CLOSURE),
    Layer(LayerName.SCAN, "Scan", "What the scanner sees now", theme.SCAN),
    Layer(LayerName.PATH, "Path", "The planned path and its goal", theme.PATH),
    Layer(LayerName.ROBOT, "Robot", "The robot's outline", theme.ROBOT),
)


class MapLayers:
    """The items in one view box."""

    def __init__(self, view_box: pg.ViewBox) -> None:
        self._image = pg.ImageItem(axisOrder="row-major", lut=colour_table(), levels=(0, 255))
        self._trajectory = pg.PlotCurveItem(antialias=True, pen=pg.mkPen(theme.TRAJECTORY, width=2))
        self._keyframes = _dots(theme.TRAJECTORY, 4)
        self._closures = pg.PlotCurveItem(antialias=True, pen=pg.mkPen(theme.CLOSURE, width=1.5), connect="pairs")
        self._scan = _dots(theme.SCAN, 4)
        self._path = pg.PlotCurveItem(
            antialias=True, pen=pg.mkPen(theme.PATH, width=2.5, style=pg.QtCore.Qt.PenStyle.DashLine)
        )
        self._goal = pg.ScatterPlotItem(size=26, symbol="crosshair", pen=pg.mkPen(theme.GOAL, width=2.5), brush=None)
        self._robot = _polygon(theme.ROBOT, 190)
        self._nose = _polygon("#ffffff", 235)
        self._items = {
            LayerName.GRID: (self._image,),
            LayerName.TRAJECTORY: (self._trajectory, self._keyframes),
            LayerName.CLOSURES: (self._closures,),
            LayerName.SCAN: (self._scan,),
            LayerName.PATH: (self._path, self._goal),
            LayerName.ROBOT: (self._robot, self._nose),
        }
        for depth, item in enumerate(item for items in self._items.values() for item in items):
            item.setZValue(depth)
            view_box.addItem(item, ignoreBounds=True)
        self._on = dict.fromkeys(LayerName, True)
        self._has_pose = False
        self._grid: GridMap | None = None
        self._snapshot: MapSnapshot | None = None
        self._scan_of: tuple[Observation | None, MapSnapshot | None] = (None, None)
        self._path_m: NDArray[np.float64] | None = None
        self._goal_m: tuple[float, float] | None = None
        self._corners_m = np.zeros((0, 2))
        self.known: Extent | None = None

    def set_visible(self, name: LayerName, on: bool) -> None:
        self._on[name] = on
        for item in self._items[name]:
            item.setVisible(on and (name is not LayerName.ROBOT or self._has_pose))

    def show_view(self, view: OperatorView) -> None:
        if view.snapshot is not self._snapshot:
            self._snapshot = view.snapshot
            self._show_grid(view.snapshot)
            self._show_trajectory(view.snapshot)
        self._show_scan(view)
        self._show_plan(view)
        self._show_robot(view)

    def _show_grid(self, snapshot: MapSnapshot | None) -> None:
        grid = None if snapshot is None else snapshot.grid
        if grid is self._grid:
            return
        self._grid = grid
        picture = None if grid is None else make_picture(grid)
        self.known = None if picture is None else picture.known
        if picture is None or picture.levels is None:
            self._image.clear()
            return
        self._image.setImage(picture.levels, autoLevels=False)
        extent = picture.extent
        self._image.setRect(QRectF(extent.left_m, extent.bottom_m, extent.width_m, extent.height_m))

    def _show_trajectory(self, snapshot: MapSnapshot | None) -> None:
        if snapshot is None:
            for item in (self._trajectory, self._keyframes, self._closures):
                item.setData([], [])
            return
        places = np.asarray(snapshot.trajectory, np.float64).reshape(-1, 4)[:, 1:3]
        shown = finite_rows(places)
        self._trajectory.setData(shown[:, 0], shown[:, 1])
        self._keyframes.setData(shown[:, 0], shown[:, 1])
        pairs = np.asarray(snapshot.closures, np.int64).reshape(-1, 2)
        pairs = pairs[((pairs >= 0) & (pairs < len(places))).all(axis=1)]
        ends = finite_rows(places[pairs].reshape(-1, 4)).reshape(-1, 2)
        self._closures.setData(ends[:, 0], ends[:, 1])

    def _show_scan(self, view: OperatorView) -> None:
        if view.observation is self._scan_of[0] and view.snapshot is self._scan_of[1]:
            return
        self._scan_of = view.observation, view.snapshot
        points = scan_on_map_m(view)
        self._scan.setData(points[:, 0], points[:, 1])

    def _show_plan(self, view: OperatorView) -> None:
        if view.path_m is not self._path_m:
            self._path_m = view.path_m
            points = np.zeros((0, 2)) if view.path_m is None else finite_rows(view.path_m[:, :2])
            self._path.setData(points[:, 0], points[:, 1])
        if view.goal_m != self._goal_m:
            self._goal_m = view.goal_m
            known = view.goal_m is not None and all(map(math.isfinite, view.goal_m))
            self._goal.setData(*([[c] for c in view.goal_m] if known and view.goal_m else ([], [])))

    def _show_robot(self, view: OperatorView) -> None:
        pose = robot_on_map(view)
        self._has_pose = pose is not None
        for item in (self._robot, self._nose):
            item.setVisible(self._has_pose and self._on[LayerName.ROBOT])
        if pose is None:
            return
        corners = footprint_m(view)
        if not np.array_equal(corners, self._corners_m):
            self._corners_m = corners
            self._robot.setPolygon(_as_polygon(corners))
            self._nose.setPolygon(_as_polygon(heading_mark_m(corners)))
        for item in (self._robot, self._nose):
            item.setPos(pose.x_m, pose.y_m)
            item.setRotation(math.degrees(pose.theta_rad))


def heading_mark_m(corners_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 2): an arrow head at the front of a footprint (N, 2), robot frame."""
    (back, right), (front, left) = corners_m.min(axis=0), corners_m.max(axis=0)
    middle, half = (left + right) / 2, (left - right) * 0.32
    base = back + 0.55 * (front - back)
    return np.array([(front - 0.06 * (front - back), middle), (base, middle + half), (base, middle - half)])


def _dots(colour: str, size_px: int) -> pg.ScatterPlotItem:
    return pg.ScatterPlotItem(size=size_px, pen=None, brush=pg.mkBrush(colour), pxMode=True)


def _polygon(colour: str, alpha: int) -> QGraphicsPolygonItem:
    item = QGraphicsPolygonItem()
    fill = QColor(colour)
    fill.setAlpha(alpha)
    pen = QPen(QColor("#0b3d1b"), 1.5)
    pen.setCosmetic(True)
    item.setPen(pen)
    item.setBrush(QBrush(fill))
    item.setVisible(False)
    return item


def _as_polygon(corners_m: NDArray[np.float64]) -> QPolygonF:
    return QPolygonF([QPointF(float(x), float(y)) for x, y in corners_m])
