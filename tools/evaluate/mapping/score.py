"""How far a map of objects is from the true things. All maps here are in the room's frame.

`object_rmse_m`: of every 2 cm of all edges in the map to the nearest true surface. `object_recall`: found of those
things that have a vertical edge in view for 10 cm or more from somewhere on the way; one is found when 70 % of these
edges are, and an edge is when along half of what can be seen of it a nearly upright edge of the map is within 4 cm.
`phantom_objects`: those that lie farther than 10 cm from every true surface over more than half of their length.
`height_error_m`: RMS, over all found things whose upper rim was in view, of the highest point of the map that is nearer
to this thing than to any other, against its true height. Where that point is the open end of an upright edge, the map
says only that the thing is at least so high. `known_height_error_m`: RMS over the others, whose height the map claims
to know; `heights_known`: their share. `edge_rmse_m`: of every 2 cm of the nearly upright edges in the map that are
within 10 cm of a corner of anything true, how far they are from it, across. `stray_edges`: the share of all that is
drawn with no edge of anything true within 4 cm. `drawn_times`: by how many edges of the map the true ones are drawn, in
the mean over every 2 cm of them by which something runs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from station_gui.mapping.objects.open_tops import open_tops
from station_gui.mapping.snapshot import ObjectMap
from tools.evaluate.mapping.edges import STEP_M, SeenThings, TrueEdge
from tools.evaluate.mapping.world import TrueWorld

FloatArray = NDArray[np.float64]

_EDGE_NEAR_M = 0.04
_EDGE_SHARE = 0.5  # of what can be seen of an edge
_ITEM_SHARE = 0.7  # of the edges that can be seen of a thing
_PHANTOM_M = 0.10  # what is farther off belongs to nothing true
_UPRIGHT_COS = math.cos(math.radians(30.0))
_FINE_M = 0.005
_SAME_TOP_M = 0.03  # of two edges


@dataclass(frozen=True, slots=True)
class ObjectError:
    """Not a number where there is nothing to measure."""

    object_rmse_m: float
    edge_rmse_m: float
    object_recall: float
    phantom_objects: int
    height_error_m: float
    known_height_error_m: float
    heights_known: float
    stray_edges: float
    drawn_times: float
    objects: int  # in the map
    true_objects: int  # that can have been seen
    missed: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Heights:
    """(H,) each: how much too high a thing is drawn, and whether the map claims to know how high it is."""

    off_m: FloatArray
    known: NDArray[np.bool_]


def object_error(objects: ObjectMap, world: TrueWorld, things: SeenThings) -> ObjectError:
    """`objects`: room frame."""
    segments_m = objects.segments_m
    points_m, segment = sampled(segments_m, STEP_M)
    off_m = np.abs(world.signed_distance_m(points_m))
    upright_m = segments_m[_is_upright(segments_m)]
    found = _found_items(things, _found_edges(upright_m, things.edges))
    stray, times = _drawn(points_m, segment, world.edge_lines_m())
    near = off_m < _PHANTOM_M
    tops_m = {k: top_m for k, top_m in things.tops_m.items() if k in found}
    heights = _heights(points_m[near], open_tops(segments_m)[segment[near]], world, tops_m)
    names = [world.scenario.items[k].name for k in things.items if k not in found]
    return ObjectError(
        object_rmse_m=_rms(off_m),
        edge_rmse_m=_rms(_across_m(upright_m, world.corner_lines_m())),
        object_recall=len(found) / len(things.items) if things.items else math.nan,
        phantom_objects=_phantoms(off_m, objects.cluster[segment]),
        height_error_m=_rms(heights.off_m),
        known_height_error_m=_rms(heights.off_m[heights.known]),
        heights_known=float(np.mean(heights.known)) if len(heights.known) else math.nan,
        stray_edges=stray,
        drawn_times=times,
        objects=len(np.unique(objects.cluster)),
        true_objects=len(things.items),
        missed=tuple(names),
    )


def sampled(segments_m: NDArray[np.floating], step_m: float) -> tuple[FloatArray, NDArray[np.int64]]:
    """The middles (N, 3) of pieces of about `step_m` of all segments (S, 2, 3), and the segment of each."""
    starts_m = np.asarray(segments_m[:, 0], dtype=np.float64)
    along = segments_m[:, 1] - starts_m
    counts = np.maximum(1, np.round(np.linalg.norm(along, axis=1) / step_m)).astype(np.int64)
    segment = np.repeat(np.arange(len(counts)), counts)
    number = np.arange(len(segment)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = ((number + 0.5) / counts[segment])[:, None] if len(segment) else np.zeros((0, 1))
    return starts_m[segment] + share * along[segment], segment


def _is_upright(segments_m: NDArray[np.floating]) -> NDArray[np.bool_]:
    along = segments_m[:, 1] - segments_m[:, 0]
    return np.asarray(np.abs(along[:, 2]) > _UPRIGHT_COS * np.maximum(np.linalg.norm(along, axis=1), 1e-9))


def _found_edges(upright_m: NDArray[np.floating], edges: list[TrueEdge]) -> list[bool]:
    """Of each true edge."""
    if len(upright_m) == 0:
        return [False] * len(edges)
    tree = cKDTree(sampled(upright_m, _FINE_M)[0])
    return [bool(np.mean(tree.query(edge.seen_m)[0] <= _EDGE_NEAR_M) >= _EDGE_SHARE) for edge in edges]


def _found_items(things: SeenThings, found_edges: list[bool]) -> set[int]:
    of_item: dict[int, list[bool]] = {}
    for edge, found in zip(things.edges, found_edges, strict=True):
        of_item.setdefault(edge.item, []).append(found)
    return {item for item, hits in of_item.items() if sum(hits) >= _ITEM_SHARE * len(hits)}


def _across_m(upright_m: NDArray[np.floating], corner_lines_m: FloatArray) -> FloatArray:
    """Level distances of what the map has to the nearest true edge, where there is one."""
    points_m = sampled(upright_m, STEP_M)[0]
    true_m = sampled(corner_lines_m, STEP_M)[0]
    nearest = np.asarray(cKDTree(true_m).query(points_m, distance_upper_bound=_PHANTOM_M)[1], dtype=np.int64)
    known = nearest < len(true_m)
    off_m = points_m[known, :2] - true_m[nearest[known], :2]
    return np.asarray(np.hypot(off_m[:, 0], off_m[:, 1]), dtype=np.float64)


def _drawn(points_m: FloatArray, segment: NDArray[np.int64], edge_lines_m: FloatArray) -> tuple[float, float]:
    """The share of the points far from every true edge, and by how many segments what is drawn of these is drawn."""
    if len(points_m) == 0:
        return math.nan, math.nan
    true_m = sampled(edge_lines_m, STEP_M)[0]
    nearest = np.asarray(cKDTree(true_m).query(points_m, distance_upper_bound=_EDGE_NEAR_M)[1], dtype=np.int64)
    known = nearest < len(true_m)
    pairs = np.unique(np.column_stack((nearest, segment))[known], axis=0)
    times = len(pairs) / len(np.unique(pairs[:, 0])) if len(pairs) else math.nan
    return 1.0 - float(np.mean(known)), times


def _phantoms(off_m: FloatArray, cluster: NDArray[np.int32]) -> int:
    if len(cluster) == 0:
        return 0
    pieces = np.bincount(cluster)
    far = np.bincount(cluster, weights=off_m > _PHANTOM_M)
    return int(np.count_nonzero(far > 0.5 * np.maximum(pieces, 1)))


def _heights(points_m: FloatArray, is_open: NDArray[np.bool_], world: TrueWorld, tops_m: dict[int, float]) -> _Heights:
    """`points_m`: (N, 3) of the map, near true surfaces; `is_open`: (N,) those of edges that may go on above."""
    item = world.nearest_item(points_m)
    off_m, known = [], []
    for k in sorted(tops_m):
        of_item = item == k
        if of_item.any():
            top_m = points_m[of_item, 2].max()
            off_m.append(top_m - tops_m[k])
            known.append(bool((points_m[of_item & ~is_open, 2] > top_m - _SAME_TOP_M).any()))
    return _Heights(np.array(off_m, np.float64), np.array(known, np.bool_))


def _rms(values: FloatArray) -> float:
    return math.sqrt(float(np.mean(np.square(values)))) if len(values) else math.nan
