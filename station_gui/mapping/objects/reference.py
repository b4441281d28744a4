"""Steps 3 to 5: straight lines of the 2D map, and edges moved onto them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.objects.config import ReferenceConfig
from station_gui.mapping.objects.dbscan.dbscan import Density, cluster_lines, nearest_clusters
from station_gui.mapping.objects.fusing.fused_edges import Edges

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_CORNER_SINE = 0.5


def first_clusters(lines_m: FloatArray, objects: IntArray, config: ReferenceConfig) -> IntArray:
    """Step 2: (N,) the cluster of each line, -1 for noise; `lines_m`: (N, 2, 2)."""
    density = Density(config.turn_rad, config.reach_m, config.min_objects, config.offset_weight)
    return cluster_lines(lines_m, objects, density)


def joined_owners(nodes_m: FloatArray, lines_m: FloatArray, config: ReferenceConfig) -> IntArray:
    """Step 4: (N,) which cells belong together when lines that continue one another become one, -1 for none."""
    density = Density(config.turn_rad, config.line_reach_m, 1, config.line_offset_weight)
    labels = cluster_lines(lines_m, np.ones(len(lines_m), np.int64), density)
    return nearest_clusters(nodes_m, lines_m, labels, config.same_m)


def aligned(edges: Edges, lines_m: FloatArray, config: ReferenceConfig) -> Edges:
    """Step 5: every edge is turned and moved towards its line (eqs 34 and 35), an upright one towards its corner.

    The line and the edge itself are two measurements of one place: the mean of both is better than either.
    """
    if len(lines_m) == 0 or len(edges.ends_m) == 0:
        return edges
    ends_m = edges.ends_m.copy()
    level = ~edges.upright
    ends_m[level, :, :2] = _on_lines(ends_m[level, :, :2], lines_m, config)
    ends_m[edges.upright, :, :2] = _on_corners(ends_m[edges.upright, 0, :2], lines_m, config)[:, None]
    return replace(edges, ends_m=edges.ends_m + config.line_weight * (ends_m - edges.ends_m))


def _on_lines(ends_m: FloatArray, lines_m: FloatArray, config: ReferenceConfig) -> FloatArray:
    """Both ends of each edge, (E, 2, 2), moved onto the nearest line that runs the same way, where one is near."""
    along, length_m = directions(lines_m)
    way = ends_m[:, 1] - ends_m[:, 0]
    sine = np.abs(np.outer(way[:, 1], along[:, 0]) - np.outer(way[:, 0], along[:, 1]))
    sine /= np.maximum(np.hypot(way[:, 0], way[:, 1]), 1e-9)[:, None]
    places_m, across_m = coordinates(ends_m.reshape(-1, 2), lines_m, along)
    places_m, across_m = places_m.reshape(-1, 2, len(lines_m)), across_m.reshape(-1, 2, len(lines_m))
    offsets_m = np.abs(across_m).max(axis=1)
    beyond_m = np.maximum(places_m.min(axis=1) - length_m, -places_m.max(axis=1))
    usable = (sine <= np.sin(config.turn_rad)) & (offsets_m <= config.most_m) & (beyond_m <= config.reach_m)
    best = np.where(usable, offsets_m, np.inf).argmin(axis=1)
    rows = np.arange(len(ends_m))
    moved_m = lines_m[best, None, 0] + places_m[rows, :, best][..., None] * along[best, None]
    return np.where(usable[rows, best][:, None, None], moved_m, ends_m)


def _on_corners(points_m: FloatArray, lines_m: FloatArray, config: ReferenceConfig) -> FloatArray:
    """Each place, (P, 2), moved onto the nearest line, or where that crosses another one at this corner."""
    along, length_m = directions(lines_m)
    places_m, across_m = coordinates(points_m, lines_m, along)
    offsets_m = np.abs(across_m)
    near = (offsets_m <= config.most_m) & (places_m >= -config.most_m) & (places_m <= length_m + config.most_m)
    first = np.where(near, offsets_m, np.inf).argmin(axis=1)
    rows = np.arange(len(points_m))
    on_line_m = lines_m[first, 0] + places_m[rows, first][:, None] * along[first]
    turn = along[first, 0, None] * along[None, :, 1] - along[first, 1, None] * along[None, :, 0]
    crossing = near & (np.abs(turn) >= _CORNER_SINE)
    second = np.where(crossing, offsets_m, np.inf).argmin(axis=1)
    between_m = lines_m[second, 0] - on_line_m
    sine = np.where(crossing[rows, second], turn[rows, second], 1.0)
    t = (between_m[:, 0] * along[second, 1] - between_m[:, 1] * along[second, 0]) / sine
    corner_m = on_line_m + t[:, None] * along[first]
    away_m = np.hypot(*(corner_m - points_m).T)
    cornered = crossing[rows, second] & (away_m <= 2.0 * config.most_m)
    moved_m = np.where(cornered[:, None], corner_m, on_line_m)
    doubtful = (near & (np.abs(turn) < _CORNER_SINE)).sum(axis=1) > 1  # between two fronts that are a step apart
    return np.where((near[rows, first] & ~doubtful)[:, None], moved_m, points_m)


def coordinates(points_m: FloatArray, lines_m: FloatArray, along: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N, R) each: how far along each line a point lies and how far beside it."""
    x_m, y_m = (points_m[:, k, None] - lines_m[:, 0, k] for k in range(2))
    return x_m * along[:, 0] + y_m * along[:, 1], along[:, 0] * y_m - along[:, 1] * x_m


def directions(lines_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(R, 2) unit vectors along the lines and (R,) their lengths."""
    way = lines_m[:, 1] - lines_m[:, 0]
    length_m = np.hypot(way[:, 0], way[:, 1])
    return way / np.maximum(length_m, 1e-9)[:, None], length_m
