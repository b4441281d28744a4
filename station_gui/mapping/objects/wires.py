"""Upright and level edges that meet: a wireframe."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from station_gui.mapping.objects.config import SurfaceConfig
from station_gui.mapping.objects.fusing.fused_edges import Edges
from station_gui.mapping.objects.reference import coordinates, directions

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_ALONG_SINE = 0.17  # 10 degrees
_ACROSS_M = 0.025  # an upright edge that stands farther beside a level one is of another front


@dataclass(frozen=True, slots=True, eq=False)
class Wires:
    """`posts_m`: (P, 2, 3) from below to above, `rails_m`: (L, 2, 3) of one height each, map frame."""

    posts_m: FloatArray
    rails_m: FloatArray

    def heights_m(self) -> FloatArray:
        """(L,) of the level ones."""
        return self.rails_m[:, 0, 2]


def tidied(edges: Edges, config: SurfaceConfig, *, with_floor: bool) -> Wires:
    """Ends that meet become one, what begins just over the floor stands on it.

    `with_floor`: level edges on the floor stay; they only repeat the 2D map, and cut across its corners.
    """
    posts_m, rails_m = edges.ends_m[edges.upright].copy(), edges.ends_m[~edges.upright].copy()
    if not with_floor:
        rails_m = rails_m[rails_m[:, :, 2].mean(axis=1) > config.floor_m]
    rails_m[:, :, 2] = rails_m[:, :, 2].mean(axis=1, keepdims=True)
    posts_m[:, 0, 2] = np.where(posts_m[:, 0, 2] < config.floor_m, 0.0, posts_m[:, 0, 2])
    if len(posts_m) and len(rails_m):
        _meet(posts_m, rails_m, config.join_m)
    return Wires(posts_m, rails_m)


def standing(wires: Wires, nodes_m: FloatArray, config: SurfaceConfig) -> Wires:
    """Upright edges over an occupied cell, (N, 2), go down to the floor: something smaller hid their lower ends."""
    if len(nodes_m) == 0 or len(wires.posts_m) == 0:
        return wires
    posts_m = wires.posts_m.copy()
    reach_m, _ = cKDTree(nodes_m).query(posts_m[:, 0, :2])
    posts_m[:, 0, 2] = np.where(reach_m <= config.over_cell_m, 0.0, posts_m[:, 0, 2])
    return Wires(posts_m, wires.rails_m)


def without_chords(wires: Wires, lines_m: FloatArray, config: SurfaceConfig) -> Wires:
    """Without short level edges that lead from one line of the 2D map, (R, 2, 2), to another and lie along none.

    The extraction joins what stands close together; from above, such an edge cuts a corner.
    """
    rails_m = wires.rails_m
    if len(lines_m) == 0 or len(rails_m) == 0:
        return wires
    way = rails_m[:, 1, :2] - rails_m[:, 0, :2]
    length_m = np.hypot(way[:, 0], way[:, 1])
    along, line_length_m = directions(lines_m)
    at_m, off_m = coordinates(rails_m[:, :, :2].reshape(-1, 2), lines_m, along)
    near = (np.abs(off_m) <= config.join_m) & (at_m > -config.join_m) & (at_m < line_length_m + config.join_m)
    first, last = near[0::2], near[1::2]
    cross_m = np.abs(np.outer(way[:, 0], along[:, 1]) - np.outer(way[:, 1], along[:, 0]))
    lies_along = ((first | last) & (cross_m < _ALONG_SINE * length_m[:, None])).any(axis=1)
    chord = first.any(axis=1) & last.any(axis=1) & ~lies_along & (length_m < config.longest_chord_m)
    return Wires(wires.posts_m, rails_m[~chord])


def near_pairs(a_m: FloatArray, b_m: FloatArray, reach_m: float) -> tuple[IntArray, IntArray]:
    """Pairs of indices of points, (A, D) and (B, D), within `reach_m` of one another, in the order of the first."""
    if len(a_m) == 0 or len(b_m) == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    found = cKDTree(a_m).sparse_distance_matrix(cKDTree(b_m), reach_m, output_type="ndarray")
    order = np.lexsort((found["j"], found["i"]))
    return found["i"][order].astype(np.int64), found["j"][order].astype(np.int64)


def _meet(posts_m: FloatArray, rails_m: FloatArray, join_m: float) -> None:
    """Level edges end at the upright ones that they reach; an upright one ends where a level one tops it."""
    end, post = near_pairs(rails_m[:, :, :2].reshape(-1, 2), posts_m[:, 0, :2], join_m)
    rail = end // 2
    way = rails_m[rail, 1, :2] - rails_m[rail, 0, :2]
    beside_m = posts_m[post, 0, :2] - rails_m[rail, end % 2, :2]
    across_m = np.abs(way[:, 0] * beside_m[:, 1] - way[:, 1] * beside_m[:, 0])
    z, low, high = rails_m[rail, 0, 2], posts_m[:, 0, 2], posts_m[:, 1, 2]
    usable = (
        (across_m <= _ACROSS_M * np.hypot(way[:, 0], way[:, 1])) & (z > low[post] - join_m) & (z < high[post] + join_m)
    )
    end, post, gap_m = end[usable], post[usable], np.hypot(*beside_m[usable].T)
    order = np.lexsort((post, gap_m, end))
    end, first = np.unique(end[order], return_index=True)  # the nearest upright edge of each end
    post = post[order][first]
    at = np.full(2 * len(rails_m), -1)
    at[end] = post
    whole = at[0::2] != at[1::2]  # both ends at one upright edge: there would be nothing left of it
    usable = whole[end // 2]
    rails, ends, posts = end[usable] // 2, end[usable] % 2, post[usable]
    rails_m[rails, ends, :2] = posts_m[posts, 0, :2]
    topping = np.abs(rails_m[rails, 0, 2] - high[posts]) <= join_m
    top_m = np.full(len(posts_m), -np.inf)
    np.maximum.at(top_m, posts[topping], rails_m[rails[topping], 0, 2])
    posts_m[:, 1, 2] = np.where(np.isfinite(top_m), top_m, high)
