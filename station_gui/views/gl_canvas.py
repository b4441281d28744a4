"""The OpenGL widget of the 3D map and the items in it."""

from __future__ import annotations

import logging
import math

import numpy as np
import pyqtgraph as pg
import pyqtgraph.opengl as gl
from numpy.typing import NDArray
from OpenGL import GL
from pyqtgraph.opengl.GLViewWidget import GLViewMixin
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QImage, QMouseEvent, QOpenGLContext, QPainter, QPaintEvent, QResizeEvent, QWheelEvent
from PySide6.QtWidgets import QWidget

from shared.geometry.se2 import Pose2
from station_gui.mapping.snapshot import MapSnapshot, ObjectKind
from station_gui.qt import theme
from station_gui.qt.offscreen_gl import OffscreenGl
from station_gui.views import map3d_surfaces, scene3d
from station_gui.views.camera import CameraAngles, Fit, fit_box
from station_gui.views.grid_picture import Extent, GridPicture, colour_table, cropped, make_picture
from station_gui.views.pose import finite_rows

_log = logging.getLogger(__name__)
_NO_LINES = np.zeros((0, 3), np.float32)
_GRID_STEP_M = 0.5
_FINE_GRID_UPTO_M = 40.0  # on a larger floor this grid would be a carpet
_FLOOR_MARGIN_M = 0.3  # of unknown floor around what is known
_ELEVATION_DEG = 44.0
_AZIMUTH_DEG = -68.0
_SAMPLES = 4  # for each pixel; a processor that draws in software takes twice as long with them
_KEPT_HEIGHT_M = 1.0  # walls are seen up to about here


class GlCanvas(GLViewMixin, QWidget):  # type: ignore[misc]  # pyqtgraph has no types
    """Draws the scene; `failed` tells once that this display cannot any more. Raises OpenGlError if it never could."""

    failed = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        self._gl = OffscreenGl()
        self._ready = False
        self._broken = False
        self._picture: QImage | None = None
        super().__init__(parent)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self._moved_by_hand = False
        self._known: Extent | None = None
        self.grid_step_m = _GRID_STEP_M
        self.setMinimumSize(260, 220)  # it has no size hint: a layout would give it nothing
        self.setBackgroundColor(theme.SCENE_SKY)
        self._floor = gl.GLImageItem(np.zeros((1, 1, 4), np.uint8), glOptions="opaque")
        self._floor_grid = _painted(theme.MAP_OCCUPIED, 1.2, 0.22, mode="lines")
        self._large = _lines(theme.OBJECT_LARGE, 2.2)
        self._small = _lines(theme.OBJECT_SMALL, 2.2)
        self._trail = _painted(theme.TRAJECTORY, 2.0)
        self._path = _painted(theme.PATH, 2.5)
        self._goal = _lines(theme.GOAL, 2.5)
        self._surfaces, self._robot, self._flat = _mesh_item("opaque"), _mesh_item("opaque"), _mesh_item("translucent")
        lines = (self._floor_grid, self._trail, self._path, self._goal, self._large, self._small)
        for item in (self._floor, *lines[:3], self._surfaces, *lines[3:], self._robot, self._flat):
            item.setVisible(False)
            self.addItem(item)
        self.reset_camera(None)

    # --- what pyqtgraph's mixin wants of its widget ---

    def isValid(self) -> bool:  # noqa: N802 - pyqtgraph's name
        return self._ready

    def context(self) -> QOpenGLContext:
        return self._gl.context

    def update(self, *_where: object) -> None:
        """The scene has changed: it is drawn anew with the next repaint."""
        self._picture = None
        super().update()

    def drawItemTree(self, *_: object, **__: object) -> None:  # noqa: N802 - pyqtgraph's name
        """All items, in their order; unlike pyqtgraph's own, it does not print what fails and go on."""
        for item in self.items:
            if item.visible():
                self._modelViewStack.append(self.currentModelView() * item.transform())
                item.paint()
                self._modelViewStack.pop()

    # --- painting ---

    def paintEvent(self, _event: QPaintEvent) -> None:  # noqa: N802 - Qt's name
        if self._picture is None and not self._broken:
            self._picture = self._render(0 if self._gl.in_software else _SAMPLES)
        painter = QPainter(self)
        if self._picture is not None:
            painter.drawImage(self.rect(), self._picture)
        painter.end()

    def resizeEvent(self, event: QResizeEvent) -> None:  # noqa: N802 - Qt's name
        self._picture = None
        if not self._moved_by_hand:
            self.frame(self._known)
        super().resizeEvent(event)

    def _render(self, samples: int) -> QImage | None:
        ratio = self.devicePixelRatioF()
        try:
            width_px, height_px = round(self.width() * ratio), round(self.height() * ratio)
            return self._gl.picture(width_px, height_px, samples, self._paint_scene)
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way; the window goes on
            self._give_up(error)
            return None

    def _paint_scene(self) -> None:
        if not self._ready:
            self.initializeGL()
            self._ready = True
        region = self.getViewport()
        self.paint(region=region, viewport=region)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:  # noqa: N802 - Qt's name
        self._moved_by_hand = True
        super().mouseMoveEvent(event)

    def wheelEvent(self, event: QWheelEvent) -> None:  # noqa: N802 - Qt's name
        self._moved_by_hand = True
        super().wheelEvent(event)

    @property
    def moved_by_hand(self) -> bool:
        return self._moved_by_hand

    def show_floor(self, snapshot: MapSnapshot) -> GridPicture:
        """The occupancy grid as the floor; returns its picture."""
        picture = cropped(make_picture(snapshot.grid), _FLOOR_MARGIN_M)
        shown = picture.levels is not None
        self._floor.setVisible(shown)
        self._floor_grid.setVisible(shown)
        if picture.levels is None:
            return picture
        extent = picture.extent
        self._floor.setData(colour_table()[picture.levels.T])
        self._floor.resetTransform()
        self._floor.scale(extent.width_m / picture.levels.shape[1], extent.height_m / picture.levels.shape[0], 1.0)
        self._floor.translate(extent.left_m, extent.bottom_m, 0.0)
        wide = max(extent.width_m, extent.height_m) > _FINE_GRID_UPTO_M
        self.grid_step_m = 10 * _GRID_STEP_M if wide else _GRID_STEP_M
        _set_lines(self._floor_grid, _on_floor(scene3d.floor_lines_m(extent, self.grid_step_m)))
        return picture

    def show_objects(self, snapshot: MapSnapshot) -> None:
        _set_lines(self._large, scene3d.segments_of(snapshot.objects, ObjectKind.LARGE))
        _set_lines(self._small, scene3d.segments_of(snapshot.objects, ObjectKind.SMALL))
        _set_mesh(self._surfaces, map3d_surfaces.measured_mesh(snapshot.objects.panels))
        _set_mesh(self._flat, map3d_surfaces.flat_mesh(snapshot.objects.panels))

    def show_trail(self, snapshot: MapSnapshot) -> None:
        places = finite_rows(np.asarray(snapshot.trajectory, np.float64).reshape(-1, 4)[:, 1:3])
        _set_lines(self._trail, _on_floor(places))

    def show_path(self, path_m: NDArray[np.float64] | None) -> None:
        _set_lines(self._path, _NO_LINES if path_m is None else _on_floor(finite_rows(path_m[:, :2])))

    def show_goal(self, goal_m: tuple[float, float] | None) -> None:
        known = goal_m is not None and all(map(math.isfinite, goal_m))
        _set_lines(self._goal, scene3d.goal_mark_m(*goal_m) if goal_m is not None and known else _NO_LINES)

    def shape_robot(self, corners_m: NDArray[np.float64]) -> None:
        _shape(self._robot, scene3d.robot_mesh(corners_m))

    def place_robot(self, pose: Pose2 | None) -> None:
        self._robot.setVisible(pose is not None)
        if pose is not None:
            self._robot.resetTransform()
            self._robot.rotate(math.degrees(pose.theta_rad), 0, 0, 1)
            self._robot.translate(pose.x_m, pose.y_m, 0)

    def forget_map(self) -> None:
        for item in self.items:
            item.setVisible(False)

    def reset_camera(self, known: Extent | None) -> None:
        """Look at all of `known` from the south, so that the map lies as it does in the view from above."""
        self._moved_by_hand = False
        self.setCameraPosition(elevation=_ELEVATION_DEG, azimuth=_AZIMUTH_DEG)
        self.frame(known)

    def frame(self, known: Extent | None) -> None:
        """Keep the direction, but bring all of `known` into view."""
        self._known = known
        if known is None:
            self.setCameraPosition(pos=pg.Vector(0, 0, 0), distance=6.0)
            return
        fit = self._fit(known, self.width() / max(1, self.height()))
        self.setCameraPosition(pos=pg.Vector(*fit.centre_m), distance=fit.distance_m)

    def _fit(self, known: Extent, aspect: float) -> Fit:
        low = np.array([known.left_m, known.bottom_m, 0.0])
        high = low + np.array([known.width_m, known.height_m, _KEPT_HEIGHT_M])
        angles = CameraAngles(*(math.radians(self.opts[name]) for name in ("azimuth", "elevation", "fov")))
        return fit_box(low, high, angles, aspect)

    def look_at(self, pose: Pose2) -> None:
        self.setCameraPosition(pos=pg.Vector(pose.x_m, pose.y_m, 0.1))

    def picture(self, width_px: int, height_px: int) -> QImage:
        """The scene alone at this size, whatever the size of the widget, framed anew unless the operator did it."""
        before = self.opts["center"], self.opts["distance"]
        if self._known is not None and not self._moved_by_hand:
            fit = self._fit(self._known, width_px / max(1, height_px))
            self.opts["center"], self.opts["distance"] = pg.Vector(*fit.centre_m), fit.distance_m
        viewport = (0, 0, width_px, height_px)
        try:
            return self._gl.picture(
                width_px, height_px, _SAMPLES, lambda: self.paint(region=viewport, viewport=viewport)
            )
        finally:
            self.opts["center"], self.opts["distance"] = before

    def polish(self) -> None:
        """Draw the scene once with smooth edges, for a picture of the window."""
        self._picture = self._render(_SAMPLES)
        super().update()

    def close_gl(self) -> None:
        self._broken = True
        self._gl.close()

    def _give_up(self, error: Exception) -> None:
        if not self._broken:
            self._broken = True
            _log.error("3D view fails: %s", error, exc_info=error)
            self.failed.emit(str(error))


def _mesh_item(options: str) -> gl.GLMeshItem:
    return gl.GLMeshItem(
        vertexes=np.zeros((3, 3), np.float32),
        faces=np.zeros((1, 3), np.uint32),
        computeNormals=False,
        smooth=False,
        glOptions=options,
    )


def _shape(item: gl.GLMeshItem, mesh: scene3d.Mesh) -> None:
    item.setMeshData(
        vertexes=mesh.vertices_m, faces=mesh.faces, faceColors=mesh.colours, computeNormals=False, smooth=False
    )


def _set_mesh(item: gl.GLMeshItem, mesh: scene3d.Mesh) -> None:
    item.setVisible(len(mesh.faces) > 0)
    if len(mesh.faces):
        _shape(item, mesh)


def _lines(colour: str, width_px: float, mode: str = "lines") -> gl.GLLinePlotItem:
    return gl.GLLinePlotItem(
        pos=_NO_LINES, color=scene3d.rgba(colour), width=width_px, mode=mode, antialias=True, glOptions="translucent"
    )


def _painted(colour: str, width_px: float, alpha: float = 1.0, mode: str = "line_strip") -> gl.GLLinePlotItem:
    """Lines that lie on the floor: drawn right after it, they need not be above it, which would flicker."""
    item = _lines(colour, width_px, mode)
    item.setData(color=scene3d.rgba(colour, alpha))
    item.updateGLOptions({GL.GL_DEPTH_TEST: False})
    return item


def _set_lines(item: gl.GLLinePlotItem, positions_m: NDArray[np.floating]) -> None:
    item.setVisible(len(positions_m) >= 2)
    if len(positions_m) >= 2:
        item.setData(pos=np.asarray(positions_m, np.float32))


def _on_floor(places_m: NDArray[np.floating]) -> NDArray[np.float32]:
    """(N, 2) to (N, 3)."""
    return np.column_stack((places_m, np.zeros(len(places_m)))).astype(np.float32)
