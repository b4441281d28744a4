"""A small ray caster: boxes on a floor, seen by the robot's L515."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from robot_app.drivers.base import DepthImage
from shared.geometry.camera import CameraMount, Intrinsics

UNIT_M = 0.00025


@dataclass(frozen=True)
class Box:
    """Axis-aligned, robot frame."""

    low_m: tuple[float, float, float]
    high_m: tuple[float, float, float]

    def edges_m(self) -> NDArray[np.float64]:
        """(12, 2, 3): its edges."""
        corners = np.array([[(self.low_m, self.high_m)[b >> a & 1][a] for a in range(3)] for b in range(8)])
        pairs = [(b, b | 1 << a) for b in range(8) for a in range(3) if not b >> a & 1]
        return corners[np.array(pairs)]


class BoxWorld:
    """Depth images of boxes on the floor."""

    intrinsics = Intrinsics.from_field_of_view(640, 480, math.radians(70), math.radians(50))
    mount = CameraMount(0.28, 0.17, 0.0)

    def depth_m(self, boxes: list[Box], floor: bool = True) -> NDArray[np.float64]:
        """(480, 640), m along the optical axis, inf where nothing is."""
        columns, rows = self.intrinsics.ray_slopes()
        optical = np.stack(np.broadcast_arrays(columns[None, :], rows[:, None], np.ones((1, 1))), axis=-1)
        pose = self.mount.robot_from_optical()
        rays = optical.astype(np.float64) @ pose[:3, :3].T
        origin = pose[:3, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (
                np.where(rays[..., 2] < 0, -origin[2] / rays[..., 2], np.inf) if floor else np.full((480, 640), np.inf)
            )
            for box in boxes:
                a = (np.array(box.low_m) - origin) / rays
                b = (np.array(box.high_m) - origin) / rays
                enter, leave = np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)
                hit = (enter <= leave) & (enter > 0)
                depth = np.where(hit & (enter < depth), enter, depth)
        return depth

    def image(
        self, boxes: list[Box], rng: np.random.Generator | None = None, floor: bool = True, flying: bool = False
    ) -> DepthImage:
        """As the L515 gives it: noise of 2 mm at 1 m growing with the square, mixed pixels at edges, 0.5 to 9 m."""
        depth = self.depth_m(boxes, floor)
        if rng is not None:
            depth = depth + rng.normal(0, 1, depth.shape) * np.minimum(0.001 + 0.001 * np.minimum(depth, 10) ** 2, 0.02)
        if flying and rng is not None:
            with np.errstate(invalid="ignore"):
                jump = np.abs(np.diff(depth, axis=1, append=depth[:, -1:])) > 0.05
                share = rng.random(depth.shape)
                mixed = share * depth + (1 - share) * np.roll(depth, -1, axis=1)
            depth = np.where(jump & np.isfinite(mixed), mixed, depth)
        depth = np.where((depth >= 0.5) & (depth <= 9.0), depth, 0.0)
        return DepthImage(0.0, np.round(depth / UNIT_M).astype(np.uint16), UNIT_M)


ROOM = [
    Box((1.6, 0.3, 0.0), (1.9, 0.7, 0.4)),
    Box((1.2, -0.6, 0.0), (1.5, -0.3, 0.15)),
    Box((2.4, -0.3, 0.0), (2.6, 0.0, 0.9)),
    Box((3.4, -2.0, 0.0), (3.5, 2.0, 1.2)),
    Box((0.0, -1.5, 0.0), (3.4, -1.4, 1.2)),
]


@pytest.fixture
def world() -> BoxWorld:
    return BoxWorld()


@pytest.fixture
def room() -> list[Box]:
    return list(ROOM)


@pytest.fixture(scope="session")
def room_image() -> DepthImage:
    """The room with noise and flying pixels, drawn once for all tests."""
    image = BoxWorld().image(ROOM, np.random.default_rng(1), flying=True)
    image.depth.setflags(write=False)
    return image
