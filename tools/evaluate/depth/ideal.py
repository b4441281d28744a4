"""The ideal drawing of a simulated view: every edge of every box that is in sight, cut where something hides it.

The boxes are known, so what is seen is told by casting rays, without an image, noise or the extraction's own rules.
An edge is in sight where it is the first thing on its ray, and can be seen there at all: around it surfaces through it
face different ways (a bend), or one ends before something deeper (a step). Two boxes flush with one another have none
between them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from shared.geometry.camera import CameraMount, Intrinsics
from shared.geometry.se2 import Pose2
from tools.simulator.solids import Solid

FloatArray = NDArray[np.float64]

_STEP_M = 0.01  # of the points that are looked at along an edge
_RANGE_M = (0.5, 9.0)  # of the camera
_BORDER_PX = 4.0
_RING_PX = 2.0  # how far round a point the surfaces are asked
_ON_PLANE_M = 0.01
_LEAST_STEP_M = 0.025
_FLAT_COS = 0.8  # surfaces whose normals are nearer to each other do not bend
_LONGEST_GAP = 4  # points that are bridged: an edge behind a thin leg is one
_LEAST_POINTS = 6
_SAME_EDGE_M, _PARALLEL_COS = 0.03, 0.9
_SAME_NODE_M = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A camera in the room: `origin_m` (3,), `room_from_optical` (3, 3)."""

    origin_m: FloatArray
    room_from_optical: FloatArray
    intrinsics: Intrinsics

    @staticmethod
    def of(room_from_robot: Pose2, mount: CameraMount, intrinsics: Intrinsics) -> View:
        matrix = mount.robot_from_optical()
        here = Pose2(0.0, 0.0, room_from_robot.theta_rad)
        origin_m = room_from_robot.apply_3d(matrix[None, :3, 3])[0]
        return View(origin_m, here.apply_3d(matrix[:3, :3].T).T, intrinsics)

    def rays(self, pixels: FloatArray) -> FloatArray:
        """(N, 3), room frame, of pixels (N, 2); as long as to have a depth of 1 m."""
        lens = self.intrinsics
        slopes = (pixels - (lens.cx, lens.cy)) / (lens.fx, lens.fy)
        rays: FloatArray = np.column_stack((slopes, np.ones(len(slopes)))) @ self.room_from_optical.T
        return rays

    def see(self, points_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(N, 2) pixels and (N,) depths, m, of points (N, 3) in the room."""
        lens = self.intrinsics
        optical_m = (points_m - self.origin_m) @ self.room_from_optical
        depth_m = optical_m[:, 2]
        scaled = optical_m[:, :2] / np.where(np.abs(depth_m) < 1e-9, 1e-9, depth_m)[:, None]
        return scaled * (lens.fx, lens.fy) + (lens.cx, lens.cy), depth_m


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """`lines_m`: (P, 3) each, room frame, points every centimetre along the straight lines; how many ends they have."""

    lines_m: tuple[FloatArray, ...]
    nodes: int

    @property
    def connections(self) -> int:
        return len(self.lines_m)

    @property
    def points_m(self) -> FloatArray:
        return np.concatenate((np.zeros((0, 3)), *self.lines_m))


def ideal_drawing(view: View, solids: Sequence[Solid]) -> Drawing:
    """All visible lines, one for parallel ones within 3 cm of one another; ends within 5 cm are one node."""
    pieces = [piece for edge_m in _edges(solids) for piece in _visible(view, solids, edge_m)]
    lines_m = _without_doubles(sorted(pieces, key=len, reverse=True))
    nodes_m: list[FloatArray] = []
    for end_m in (line_m[k] for line_m in lines_m for k in (0, -1)):
        if all(np.linalg.norm(end_m - node_m) >= _SAME_NODE_M for node_m in nodes_m):
            nodes_m.append(end_m)
    return Drawing(tuple(lines_m), len(nodes_m))


def cast(origin_m: FloatArray, rays: FloatArray, solids: Iterable[Solid]) -> tuple[FloatArray, FloatArray]:
    """Depth (N,) of what rays (N, 3) hit first, the floor at z = 0 or a box, inf for nothing; and its plane (N, 4):
    the normal n towards the camera and n . p for its points p."""
    safe = np.where(np.abs(rays) < 1e-12, 1e-12, rays)
    depth = np.where(safe[:, 2] < 0, -origin_m[2] / safe[:, 2], np.inf)
    plane = np.tile((0.0, 0.0, 1.0, 0.0), (len(rays), 1))
    for solid in solids:
        turn, center_m, half_m = _axes(solid), np.array(solid.center_m), np.array(solid.half_m)
        local, ways = (origin_m - center_m) @ turn, rays @ turn
        ways = np.where(np.abs(ways) < 1e-12, 1e-12, ways)
        enter = (-np.sign(ways) * half_m - local) / ways
        leave = ((np.sign(ways) * half_m - local) / ways).min(axis=1)
        axis = enter.argmax(axis=1)
        at = np.take_along_axis(enter, axis[:, None], axis=1)[:, 0]
        first = (at <= leave) & (at > 0) & (at < depth)
        normal = -np.sign(np.take_along_axis(ways, axis[:, None], axis=1)) * turn.T[axis]
        depth = np.where(first, at, depth)
        plane[first] = np.column_stack((normal, normal @ center_m + half_m[axis]))[first]
    return depth, plane


def _axes(solid: Solid) -> FloatArray:
    c, s = np.cos(solid.yaw_rad), np.sin(solid.yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _edges(solids: Iterable[Solid]) -> Iterable[FloatArray]:
    """(P, 3) points along each of the twelve edges of each box, room frame."""
    for solid in solids:
        half_m = np.array(solid.half_m)
        for axis in range(3):
            count = max(2, round(2 * half_m[axis] / _STEP_M) + 1)
            for signs in product((-1.0, 1.0), repeat=2):
                local = np.tile(np.insert(signs, axis, 0.0) * half_m, (count, 1))
                local[:, axis] = np.linspace(-half_m[axis], half_m[axis], count)
                yield local @ _axes(solid).T + np.array(solid.center_m)


def _visible(view: View, solids: Sequence[Solid], edge_m: FloatArray) -> list[FloatArray]:
    """The pieces of an edge that are in sight."""
    pixels, depth_m = view.see(edge_m)
    size = (view.intrinsics.width, view.intrinsics.height)
    inside = ((pixels >= _BORDER_PX) & (pixels < np.array(size) - _BORDER_PX)).all(axis=1)
    at = np.flatnonzero(inside & (depth_m >= _RANGE_M[0]) & (depth_m <= _RANGE_M[1]))
    if len(at):
        first_m, _ = cast(view.origin_m, view.rays(pixels[at]), solids)
        at = at[first_m >= depth_m[at] - _ON_PLANE_M]
    if len(at):
        at = at[_stands_out(view, solids, edge_m[at])]
    if len(at) == 0:
        return []
    runs = np.split(at, np.flatnonzero(np.diff(at) > _LONGEST_GAP + 1) + 1)
    return [edge_m[run] for run in runs if len(run) >= _LEAST_POINTS]


def _stands_out(view: View, solids: Iterable[Solid], points_m: FloatArray) -> NDArray[np.bool_]:
    """(N,) whether around a point surfaces through it bend, or end before something deeper."""
    pixels, depth_m = view.see(points_m)
    angles = np.arange(8) * (np.pi / 4)
    around = pixels[:, None] + _RING_PX * np.column_stack((np.cos(angles), np.sin(angles)))
    hit_m, plane = cast(view.origin_m, view.rays(around.reshape(-1, 2)), solids)
    hit_m, plane = hit_m.reshape(-1, 8), plane.reshape(-1, 8, 4)
    known = np.isfinite(hit_m)
    off_m = np.einsum("nkc,nc->nk", plane[..., :3], points_m) - plane[..., 3]
    own = known & (np.abs(off_m) < _ON_PLANE_M)
    alike = np.einsum("nac,nbc->nab", plane[..., :3], plane[..., :3]) >= _FLAT_COS
    bends = (own[:, :, None] & own[:, None, :] & ~alike).any(axis=(1, 2))
    steps = own.any(axis=1) & (~own & (hit_m > depth_m[:, None] + _LEAST_STEP_M)).any(axis=1)
    found: NDArray[np.bool_] = bends | steps
    return found


def _without_doubles(pieces: list[FloatArray]) -> list[FloatArray]:
    """Leaves out what lies mostly along longer lines of the same direction."""
    kept: list[FloatArray] = []
    for piece in pieces:
        beside = [line for line in kept if abs(_direction(line) @ _direction(piece)) > _PARALLEL_COS]
        if beside:
            doubled = cKDTree(np.concatenate(beside)).query(piece)[0] <= _SAME_EDGE_M
            if np.count_nonzero(~doubled) < _LEAST_POINTS - 1 or 2 * np.count_nonzero(doubled) > len(piece):
                continue
        kept.append(piece)
    return kept


def _direction(line_m: FloatArray) -> FloatArray:
    way: FloatArray = line_m[-1] - line_m[0]
    return way / np.linalg.norm(way)
