"""Pictures of extracted networks, as figure 14 of paper 1: over the depth image, and in 3D from two sides.

The cloud is white, far points darker; nodes and connections are coloured by their cluster.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from robot_app.drivers.base import DepthImage
from robot_app.perception.object_extractor import clusters
from robot_app.perception.point_cloud import Mount
from shared.geometry.camera import Intrinsics
from shared.messages import ObjectNetwork
from tools.evaluate.depth.labels import cloud_m

FloatArray = NDArray[np.float64]

_SIDE_PX = (640, 480)
_TURN_RAD = math.radians(35)  # of the two views, to the left and to the right
_TILT_RAD = math.radians(30)  # down
_FOCAL = 1.1  # of the views' own camera, in picture widths
_BACK = 1.6  # how far it stands from the middle of the scene, in radii of the scene
_COLOURS = (
    (255, 70, 70),
    (80, 255, 80),
    (100, 140, 255),
    (255, 170, 0),
    (0, 255, 255),
    (255, 90, 255),
    (255, 255, 150),
    (170, 110, 255),
    (255, 150, 150),
    (120, 220, 170),
)


def draw(image: DepthImage, objects: ObjectNetwork, intrinsics: Intrinsics, mount: Mount) -> Image.Image:
    """The three views beside each other."""
    sides = [draw_side(image, objects, intrinsics, mount, turn) for turn in (_TURN_RAD, -_TURN_RAD)]
    over = draw_over(image, objects, intrinsics, mount).resize(_SIDE_PX, Image.Resampling.LANCZOS)
    page = Image.new("RGB", (3 * _SIDE_PX[0] + 8, _SIDE_PX[1]), "white")
    for column, picture in enumerate((over, *sides)):
        page.paste(picture, (column * (_SIDE_PX[0] + 4), 0))
    return page


def draw_over(image: DepthImage, objects: ObjectNetwork, intrinsics: Intrinsics, mount: Mount) -> Image.Image:
    """The network over the depth image, near is light."""
    depth_m = image.depth * image.unit_m
    near_m, far_m = np.percentile(depth_m[depth_m > 0], (1, 99)) if (depth_m > 0).any() else (0.0, 1.0)
    scaled = (depth_m - near_m) / max(far_m - near_m, 1e-3)
    shade = np.where(depth_m > 0, np.clip(190.0 - 150.0 * scaled, 30.0, 200.0), 0.0)
    picture = Image.fromarray(shade.astype(np.uint8)).convert("RGB")
    optical_from_robot = np.linalg.inv(mount.robot_from_optical())
    points = objects.nodes_m @ optical_from_robot[:3, :3].T + optical_from_robot[:3, 3]
    u = points[:, 0] / points[:, 2] * intrinsics.fx + intrinsics.cx
    v = points[:, 1] / points[:, 2] * intrinsics.fy + intrinsics.cy
    _draw_network(ImageDraw.Draw(picture), objects, u, v)
    return picture


def draw_side(
    image: DepthImage, objects: ObjectNetwork, intrinsics: Intrinsics, mount: Mount, turn_rad: float
) -> Image.Image:
    """The cloud and the network in perspective, seen from `turn_rad` to the side and from above."""
    picture = Image.new("RGB", _SIDE_PX)
    optical_m = cloud_m(image, intrinsics)[::3, ::3].reshape(-1, 3)
    robot_from_optical = mount.robot_from_optical()
    cloud = optical_m[optical_m[:, 2] > 0] @ robot_from_optical[:3, :3].T + robot_from_optical[:3, 3]
    if not len(cloud):
        return picture
    focus = objects.nodes_m.astype(np.float64) if len(objects.nodes_m) > 2 else cloud
    low, high = np.percentile(focus, (4, 96), axis=0)
    middle, radius_m = (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 0.1)
    u, v, depth = _project(cloud - middle, turn_rad, radius_m)
    shown = (depth > 0.2 * radius_m) & (u >= 0) & (u < _SIDE_PX[0]) & (v >= 0) & (v < _SIDE_PX[1])
    shade = np.clip(230 - 70 * depth / (_BACK * radius_m), 60, 200).astype(np.uint8)
    canvas = np.zeros((_SIDE_PX[1], _SIDE_PX[0]), np.uint8)
    np.maximum.at(canvas, (v[shown].astype(int), u[shown].astype(int)), shade[shown])
    picture = Image.fromarray(canvas).convert("RGB")
    u, v, _ = _project(objects.nodes_m - middle, turn_rad, radius_m)
    _draw_network(ImageDraw.Draw(picture), objects, u, v)
    return picture


def _project(points_m: FloatArray, turn_rad: float, radius_m: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Columns, rows and depths of points (N, 3) round the middle of the scene: x forward, y left, z up."""
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    ahead, left = c * points_m[:, 0] + s * points_m[:, 1], c * points_m[:, 1] - s * points_m[:, 0]
    c, s = math.cos(_TILT_RAD), math.sin(_TILT_RAD)
    depth = np.maximum(c * ahead - s * points_m[:, 2] + _BACK * radius_m, 1e-3)
    rise = s * ahead + c * points_m[:, 2]
    focal_px = _FOCAL * _SIDE_PX[0]
    return _SIDE_PX[0] / 2 - focal_px * left / depth, _SIDE_PX[1] / 2 - focal_px * rise / depth, depth


def _draw_network(pen: ImageDraw.ImageDraw, objects: ObjectNetwork, u: FloatArray, v: FloatArray) -> None:
    colours = [_COLOURS[c % len(_COLOURS)] for c in clusters(objects).tolist()]
    for a, b in objects.edges.tolist():
        pen.line((u[a], v[a], u[b], v[b]), fill=colours[a], width=2)
    for x, y, colour in zip(u.tolist(), v.tolist(), colours, strict=True):
        pen.ellipse((x - 3, y - 3, x + 3, y + 3), outline=colour)
