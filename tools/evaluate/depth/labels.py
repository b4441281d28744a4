"""How well a network outlines labelled objects.

An organised cloud carries a label for each pixel: 0 none, 1-9 what the objects stand on, 20-29 the first object, 30-39
the second, and so on. Definitions, all in metres in the camera's frame:

- The *surface* of an object is every measured pixel that carries its label.
- Its *occluding boundary* are those of its pixels that hide something: in one of the four directions of the image the
  next measured pixel, past whatever shadow lies between, belongs to something else and is at least 2 cm deeper; or
  nothing at all is measured from there to the border of the image, over at least 16 pixels, which is where the
  background was cropped away. The image's border itself, and where an object touches another one or the table, are
  no occluding boundary.
- The *drawn* points are the connections, sampled every 1 cm.
- An object is *found* when at least 60 % of the nodes of one cluster lie within 3 cm of its boundary or surface.
- *Boundary precision* is the share of drawn points within 3 cm of the occluding boundary of any object, *boundary
  recall* the share of the boundaries' pixels within 3 cm of a drawn point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from robot_app.drivers.base import DepthImage
from shared.geometry.camera import Intrinsics

FIRST_OBJECT_LABEL = 20
_LABELS_PER_OBJECT = 10
_REACH_M = 0.03
_STEP_M = 0.01
_FOUND_SHARE = 0.6
_MIN_HIDDEN_M = 0.02
_MIN_CROPPED_PX = 16


@dataclass(frozen=True, slots=True)
class LabelFigures:
    """How many of how many: shares of several files add up by their parts."""

    objects: int
    objects_found: int
    drawn_points: int
    drawn_on_boundary: int
    boundary_points: int
    boundary_drawn: int

    def __add__(self, other: LabelFigures) -> LabelFigures:
        return LabelFigures(
            self.objects + other.objects,
            self.objects_found + other.objects_found,
            self.drawn_points + other.drawn_points,
            self.drawn_on_boundary + other.drawn_on_boundary,
            self.boundary_points + other.boundary_points,
            self.boundary_drawn + other.boundary_drawn,
        )

    @property
    def object_recall(self) -> float | None:
        return _share(self.objects_found, self.objects)

    @property
    def boundary_precision(self) -> float | None:
        return _share(self.drawn_on_boundary, self.drawn_points)

    @property
    def boundary_recall(self) -> float | None:
        return _share(self.boundary_drawn, self.boundary_points)


def _share(part: int, whole: int) -> float | None:
    return round(part / whole, 4) if whole else None


def compare_with_labels(
    image: DepthImage,
    labels: NDArray[np.int32],
    intrinsics: Intrinsics,
    nodes_m: NDArray[np.float64],
    connections: NDArray[np.int64],
    cluster_of: NDArray[np.int32],
) -> LabelFigures:
    """`labels`: (H, W). `nodes_m`: (N, 3) optical frame. `connections`: (M, 2). `cluster_of`: (N,)."""
    points_m = cloud_m(image, intrinsics)
    owner = object_of(labels, image.depth > 0)
    boundary = occluding_boundary(points_m[..., 2], owner)
    drawn_m = sample_connections(nodes_m, connections)
    boundary_m = points_m[boundary]
    objects = [number for number in np.unique(owner).tolist() if number > 0]
    found = sum(_is_found(points_m[owner == number], nodes_m, cluster_of) for number in objects)
    return LabelFigures(
        len(objects),
        found,
        len(drawn_m),
        _count_near(drawn_m, boundary_m),
        len(boundary_m),
        _count_near(boundary_m, drawn_m),
    )


def cloud_m(image: DepthImage, intrinsics: Intrinsics) -> NDArray[np.float64]:
    """(H, W, 3) optical frame; zero where nothing was measured."""
    columns, rows = intrinsics.ray_slopes()
    depth_m = image.depth * image.unit_m
    stacked: NDArray[np.float64] = np.stack((columns[None, :] * depth_m, rows[:, None] * depth_m, depth_m), axis=-1)
    return stacked


def object_of(labels: NDArray[np.int32], measured: NDArray[np.bool_]) -> NDArray[np.int32]:
    """(H, W): the number of the object in each pixel from 1 on, 0 for anything else, -1 where nothing was measured."""
    numbers = np.where(labels >= FIRST_OBJECT_LABEL, labels // _LABELS_PER_OBJECT - 1, 0)
    return np.where(measured, numbers, -1).astype(np.int32)


def occluding_boundary(depth_m: NDArray[np.float64], owner: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(H, W): which pixels of objects hide something; `owner` is that of `object_of`."""
    boundary = np.zeros(owner.shape, np.bool_)
    for turns in range(4):
        turned = _hides_to_the_right(np.rot90(depth_m, turns), np.rot90(owner, turns))
        boundary |= np.rot90(turned, -turns)
    return boundary


def _hides_to_the_right(depth_m: NDArray[np.float64], owner: NDArray[np.int32]) -> NDArray[np.bool_]:
    height, width = owner.shape
    columns = np.broadcast_to(np.arange(width), (height, width))
    measured_at = np.where(owner >= 0, columns, width)
    from_here = np.minimum.accumulate(measured_at[:, ::-1], axis=1)[:, ::-1]
    beyond = np.concatenate((from_here[:, 1:], np.full((height, 1), width)), axis=1)
    at = np.minimum(beyond, width - 1)
    deeper = np.take_along_axis(depth_m, at, axis=1) >= depth_m + _MIN_HIDDEN_M
    another = np.take_along_axis(owner, at, axis=1) != owner
    cropped = (beyond == width) & (width - 1 - columns >= _MIN_CROPPED_PX)
    hides: NDArray[np.bool_] = (owner > 0) & (((beyond < width) & another & deeper) | cropped)
    return hides


def sample_connections(nodes_m: NDArray[np.float64], connections: NDArray[np.int64]) -> NDArray[np.float64]:
    """(P, 3): points every 1 cm along the connections, ends included."""
    pieces = [np.zeros((0, 3))]
    for a, b in connections.tolist():
        length_m = float(np.linalg.norm(nodes_m[b] - nodes_m[a]))
        pieces.append(np.linspace(nodes_m[a], nodes_m[b], 1 + max(1, round(length_m / _STEP_M))))
    return np.concatenate(pieces)


def _is_found(surface_m: NDArray[np.float64], nodes_m: NDArray[np.float64], cluster_of: NDArray[np.int32]) -> bool:
    if not len(nodes_m):
        return False
    near = cKDTree(surface_m).query(nodes_m, distance_upper_bound=_REACH_M)[0] <= _REACH_M
    sizes = np.bincount(cluster_of)
    return bool((np.bincount(cluster_of[near], minlength=len(sizes)) >= _FOUND_SHARE * sizes).any())


def _count_near(points_m: NDArray[np.float64], others_m: NDArray[np.float64]) -> int:
    if not len(points_m) or not len(others_m):
        return 0
    distance_m = cKDTree(others_m).query(points_m, distance_upper_bound=_REACH_M)[0]
    return int(np.count_nonzero(distance_m <= _REACH_M))
