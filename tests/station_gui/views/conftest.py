"""A station that only remembers what it was asked, and a room to look at."""

from __future__ import annotations

import dataclasses
import gc
import itertools
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import QCoreApplication, QEvent
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from shared.geometry.se2 import Pose2
from shared.link.base import LinkPath
from shared.messages import (
    Hello,
    MissionState,
    ObjectNetwork,
    Observation,
    ScanGeometry,
    StopReason,
    Telemetry,
)
from station_gui.mapping.snapshot import GridMap, MapSnapshot, ObjectKind, ObjectMap
from station_gui.model.view import LinkFigures, LinkState, LogEntry, OperatorView, Severity, Target
from station_gui.qt.application import prepare_opengl
from station_gui.qt.theme import apply_theme
from station_gui.views.config import WindowConfig
from station_gui.views.main_window import MainWindow

ROOM_M = (3.95, 4.2)  # paper 1, section 4.3
CELL_M = 0.025
# centre x, y, length, width, height, angle
BOXES = (
    (0.55, 0.45, 0.5, 0.35, 0.45, 0.3),
    (3.4, 0.6, 0.55, 0.5, 0.8, -0.1),
    (3.35, 2.6, 0.45, 0.36, 0.9, 0.4),
    (2.0, 3.75, 0.6, 0.3, 0.35, 0.0),
    (0.45, 3.3, 0.3, 0.45, 0.25, 0.7),
    (1.95, 2.0, 0.25, 0.2, 0.15, 0.5),
    (1.3, 1.1, 0.18, 0.14, 0.12, -0.4),
)
SMALL_BELOW_M = 0.3
GEOMETRY = ScanGeometry(
    math.radians(-120), math.radians(240 / 227), 0.04 * 2 / 3 / 228, 0.06, 4.0, Pose2(0.2, 0.0, 0.0)
)

prepare_opengl()


class FakeOperator:
    """Serves `current` and records the calls."""

    def __init__(self, view: OperatorView) -> None:
        self.current = view
        self.calls: list[tuple[Any, ...]] = []
        self.entries: list[LogEntry] = []

    def view(self) -> OperatorView:
        return self.current

    def change(self, **changes: Any) -> None:
        self.current = dataclasses.replace(self.current, **changes)

    def say(self, severity: Severity, text: str) -> None:
        self.entries.append(LogEntry(float(len(self.entries)), severity, text))
        self.change(log_length=len(self.entries))

    def log_since(self, index: int) -> list[LogEntry]:
        return self.entries[index:]

    def connect(self, host: str, port: int, radio_ports: tuple[str, ...] = ()) -> None:
        self.calls.append(("connect", host, port, radio_ports))

    def serial_ports(self) -> list[str]:
        return ["/dev/ttyACM0", "/dev/ttyUSB0"]

    def disconnect(self) -> None:
        self.calls.append(("disconnect",))

    def start(self) -> None:
        self.calls.append(("start",))

    def pause(self) -> None:
        self.calls.append(("pause",))

    def resume(self) -> None:
        self.calls.append(("resume",))

    def return_to_start(self) -> None:
        self.calls.append(("return_to_start",))

    def stop(self) -> None:
        self.calls.append(("stop",))

    def emergency_stop(self) -> None:
        self.calls.append(("emergency_stop",))

    def go_to(self, x_m: float, y_m: float) -> None:
        self.calls.append(("go_to", x_m, y_m))

    def save_map(self, path: Path) -> None:
        self.calls.append(("save_map", path))

    def export_map(self, folder: Path) -> None:
        self.calls.append(("export_map", folder))

    def open_map(self, path: Path, *, localise: bool) -> None:
        self.calls.append(("open_map", path, localise))

    def drive(self, speed_mps: float, steering_rad: float) -> None:
        self.calls.append(("drive", speed_mps, steering_rad))


def box_corners(box: tuple[float, ...]) -> np.ndarray:
    x, y, length, width, _height, angle = box
    half = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (length / 2, width / 2)
    return Pose2(x, y, angle).apply(half)


def wall_lines() -> np.ndarray:
    """(N, 2, 2): all vertical surfaces of the room seen from above."""
    room = np.array([[0, 0], [ROOM_M[0], 0], ROOM_M, [0, ROOM_M[1]]])
    rings = [room, *(box_corners(b) for b in BOXES)]
    return np.vstack([np.stack((r, np.roll(r, -1, axis=0)), axis=1) for r in rings])


def cast(pose: Pose2, angles: np.ndarray) -> np.ndarray:
    """Ranges to the nearest surface."""
    lines = wall_lines()
    a, d = lines[:, 0] - (pose.x_m, pose.y_m), lines[:, 1] - lines[:, 0]
    u = np.column_stack((np.cos(angles + pose.theta_rad), np.sin(angles + pose.theta_rad)))[:, None]
    cross = u[..., 0] * d[:, 1] - u[..., 1] * d[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (a[:, 0] * d[:, 1] - a[:, 1] * d[:, 0]) / cross
        s = (a[:, 0] * u[..., 1] - a[:, 1] * u[..., 0]) / cross
    return np.where((t > 0) & (s >= 0) & (s <= 1), t, np.inf).min(axis=1)


def lab_trajectory() -> np.ndarray:
    """(K, 4): once round the room."""
    corners = np.array([[0.7, 1.1], [2.6, 0.6], [3.0, 1.5], [2.7, 3.1], [1.2, 3.2], [0.7, 2.2], [0.7, 1.1]])
    t = np.linspace(0, len(corners) - 1, 61)
    x, y = (np.interp(t, range(len(corners)), corners[:, i]) for i in range(2))
    smooth = np.ones(5) / 5
    x, y = (np.convolve(np.pad(v, 2, mode="edge"), smooth, mode="valid") for v in (x, y))
    heading = np.arctan2(np.gradient(y), np.gradient(x))
    return np.column_stack((t * 8, x, y, heading))


def lab_grid(places: np.ndarray) -> GridMap:
    """What scans from these places would have shown."""
    origin, shape = (-0.5, -0.5), (208, 198)
    probability = np.full(shape, 0.5, np.float32)
    angles = np.linspace(-math.radians(120), math.radians(120), 682)
    for x, y, heading in places[::2, 1:]:
        ranges = cast(Pose2(x, y, heading), angles)
        for share in np.linspace(0.0, 0.985, 140):
            _mark(probability, origin, x, y, heading + angles, ranges * share, 0.08)
    for x, y, heading in places[::2, 1:]:
        _mark(probability, origin, x, y, heading + angles, cast(Pose2(x, y, heading), angles), 0.95)
    return GridMap(probability, origin, CELL_M)


def _mark(grid: np.ndarray, origin: tuple[float, float], x: float, y: float, a: Any, r: Any, value: float) -> None:
    columns = np.floor((x + r * np.cos(a) - origin[0]) / CELL_M).astype(int)
    rows = np.floor((y + r * np.sin(a) - origin[1]) / CELL_M).astype(int)
    grid[np.clip(rows, 0, grid.shape[0] - 1), np.clip(columns, 0, grid.shape[1] - 1)] = value


def lab_objects() -> ObjectMap:
    """Outlines of walls and boxes, as ragged as extracted ones."""
    rng = np.random.default_rng(3)
    segments: list[tuple[Any, Any]] = []
    kinds: list[int] = []
    clusters: list[int] = []

    def outline(ring: np.ndarray, height: float, kind: int, cluster: int, pieces: int) -> None:
        for start, end in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            at = start + np.linspace(0, 1, pieces + 1)[:, None] * (end - start)
            for level in np.linspace(0.05, height, 3):
                nodes = np.column_stack((at, np.full(len(at), level))) + rng.normal(0, 0.012, (len(at), 3))
                add([*itertools.pairwise(nodes)], kind, cluster)
            posts = [((x, y, 0.04), (x, y, height)) for x, y in at]
            add(posts, kind, cluster)

    def add(new: list[Any], kind: int, cluster: int) -> None:
        segments.extend(new)
        kinds.extend([kind] * len(new))
        clusters.extend([cluster] * len(new))

    room = np.array([[0, 0], [ROOM_M[0], 0], ROOM_M, [0, ROOM_M[1]]])
    outline(room, 1.0, ObjectKind.LARGE, 0, 9)
    for number, box in enumerate(BOXES):
        kind = ObjectKind.SMALL if box[4] < SMALL_BELOW_M else ObjectKind.LARGE
        outline(box_corners(box), box[4], kind, number + 1, 2)
    return ObjectMap(np.array(segments, np.float32), np.array(kinds, np.uint8), np.array(clusters, np.int32))


def lab_observation(pose: Pose2, stamp_s: float = 480.0) -> Observation:
    scanner = pose @ GEOMETRY.robot_from_scanner
    ranges = cast(scanner, GEOMETRY.angles_rad(228)) + np.random.default_rng(1).normal(0, 0.005, 228)
    return Observation(1, stamp_s, pose, 0.0, 0.0, GEOMETRY, ranges.astype(np.float32), ObjectNetwork(), True)


def lab_snapshot(revision: int = 137, keyframes: int = 61) -> MapSnapshot:
    places = lab_trajectory()[:keyframes]
    closures = np.array([[0, 58], [1, 60], [20, 40]], np.int32)
    pose = Pose2(*places[-1, 1:])
    return MapSnapshot(
        revision=revision,
        stamp_s=float(places[-1, 0]),
        map_from_robot=pose,
        map_from_odom=Pose2(),
        grid=lab_grid(places),
        objects=lab_objects(),
        trajectory=places,
        closures=closures[(closures < keyframes).all(axis=1)],
        observations=revision,
        slam_s=0.021,
        combine_s=0.009,
    )


def telemetry(state: MissionState = MissionState.COMMAND, **changes: Any) -> Telemetry:
    base = Telemetry(480.5, state, StopReason.NONE, Pose2(0.72, 1.05, -0.5), 0.18, 0.1, 0.12, 6.61, 1.4, 61.0, 11.3, 2)
    return dataclasses.replace(base, **changes)


FOOTPRINT_M = ((-0.045, -0.10), (0.305, -0.10), (0.305, 0.10), (-0.045, 0.10))
NO_FIGURES = LinkFigures(math.nan, math.nan, math.nan, math.nan, math.nan)


def disconnected_view() -> OperatorView:
    return OperatorView(
        0.0, LinkState.DISCONNECTED, Target(), NO_FIGURES, None, None, math.inf, None, None, None, None, "", 0
    )


def connected_view(state: MissionState = MissionState.COMMAND, snapshot: MapSnapshot | None = None) -> OperatorView:
    pose = snapshot.map_from_robot if snapshot is not None else Pose2(1.0, 1.0, 0.3)
    return OperatorView(
        time_s=500.0,
        link_state=LinkState.CONNECTED,
        target=Target("192.168.4.1", 7400),
        link=LinkFigures(9.8, 9.7, 812.0, 71_300.0, 0.012, LinkPath.WIFI),
        robot=Hello("mapper-1", "0.1.0", FOOTPRINT_M, 0.61),
        telemetry=telemetry(state),
        telemetry_age_s=0.08,
        observation=lab_observation(pose),
        snapshot=snapshot,
        goal_m=None,
        path_m=None,
        recording="/home/operator/missions/2026-11-22T06-35-01.mcap",
        log_length=0,
    )


@pytest.fixture(scope="session")
def scenes() -> SimpleNamespace:
    """Makes the views and parts of views that tests change to their liking."""
    return SimpleNamespace(connected_view=connected_view, disconnected_view=disconnected_view, telemetry=telemetry)


@pytest.fixture(scope="session")
def room() -> MapSnapshot:
    return lab_snapshot()


@pytest.fixture
def operator() -> FakeOperator:
    return FakeOperator(disconnected_view())


@pytest.fixture
def gl_works() -> None:
    if QGuiApplication.platformName() == "offscreen":
        pytest.skip("OpenGL needs a real or virtual X display")


OpenWindow = Callable[..., MainWindow]


@pytest.fixture
def open_window(qapp: QApplication, qtbot: QtBot, operator: FakeOperator) -> Iterator[OpenWindow]:
    """Opens the window on `operator`; afterwards it is closed and nothing of it may be left."""
    apply_theme(qapp)
    windows: list[MainWindow] = []

    def make(**changes: Any) -> MainWindow:
        config = WindowConfig(**{"width_px": 1600, "height_px": 1000, **changes})
        window = MainWindow(operator, config)
        windows.append(window)
        with qtbot.waitExposed(window):
            window.show()
        window.refresh()
        qapp.processEvents()
        return window

    yield make
    for window in windows:
        window.close()
        window.deleteLater()
    QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    windows.clear()
    gc.collect()
    left = [type(w).__name__ for w in qapp.allWidgets() if type(w).__module__.startswith("station_gui")]
    assert not left, f"widgets left behind: {left}"
