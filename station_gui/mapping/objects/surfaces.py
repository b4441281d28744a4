"""From edges to objects with surfaces (paper 1, figure 11): upright panels, top faces, and which belong together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from station_gui.mapping.objects.config import ReferenceConfig, SurfaceConfig
from station_gui.mapping.objects.flat_walls import FlatWalls
from station_gui.mapping.objects.fronts import FrontFinder, Fronts
from station_gui.mapping.objects.fusing.fused_edges import Edges
from station_gui.mapping.objects.kinds import kinds_of
from station_gui.mapping.objects.ransac.ransac import LineFitter
from station_gui.mapping.objects.wires import Wires, near_pairs, standing, tidied, without_chords
from station_gui.mapping.snapshot import NO_OBJECTS, ObjectKind, ObjectMap, Panels

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_CORNER_SINE = 0.7  # two level edges that meet so make the corner of a top face


class ObjectBuilder:
    """A function of what it is given; it only remembers what need not be worked out again."""

    def __init__(self, config: SurfaceConfig, reference: ReferenceConfig, fitter: LineFitter) -> None:
        self._config = config
        self._flat = FlatWalls(config, reference, fitter)
        self._fronts = FrontFinder(config)

    def without_reference(self, edges: Edges) -> ObjectMap:
        """Edges alone, as they were fused."""
        wires = tidied(edges, self._config, with_floor=True)
        return _assembled(wires, self._fronts.fronts_of(np.zeros((0, 2, 2)), wires), self._config)

    def build(self, edges: Edges, reference_m: FloatArray, nodes_m: FloatArray, cell_m: float) -> ObjectMap:
        """`reference_m`: (R, 2, 2) of step 4, `nodes_m`: (N, 2) occupied cells."""
        lines_m = np.concatenate((reference_m, self._flat.lines_m(nodes_m, reference_m, cell_m)))
        wires = tidied(edges, self._config, with_floor=False)
        wires = standing(without_chords(wires, lines_m, self._config), nodes_m, self._config)
        return _assembled(wires, self._fronts.fronts_of(lines_m, wires), self._config)


def _assembled(wires: Wires, fronts: Fronts, config: SurfaceConfig) -> ObjectMap:
    posts, rails = len(wires.posts_m), len(wires.rails_m)
    if posts + rails + len(fronts.heights_m) == 0:
        return NO_OBJECTS
    known = ~np.isnan(fronts.heights_m)
    owner = _objects(wires, fronts, config)
    front_owner = owner[posts + rails :]
    ends_m = np.concatenate((wires.posts_m, wires.rails_m, fronts.outlines_m))
    cluster = np.concatenate((owner[: posts + rails], front_owner[fronts.outline_of])).astype(np.int32)
    kinds = kinds_of(ends_m, cluster, config)
    kind_of = np.zeros(int(owner.max(initial=-1)) + 1, np.uint8)
    kind_of[cluster] = kinds
    tops_m, tops_owner = _top_faces(wires.rails_m, owner[posts : posts + rails], config)
    upright_m = _upright(fronts.ends_m[known], fronts.heights_m[known])
    walls_m = _upright(fronts.ends_m[~known], np.full(np.count_nonzero(~known), config.wall_height_m))
    panel_owner = np.concatenate((front_owner[known], tops_owner)).astype(np.int32)
    return ObjectMap(
        ends_m.astype(np.float32),
        kinds,
        cluster,
        Panels(
            np.concatenate((upright_m, tops_m, walls_m)).astype(np.float32),
            np.concatenate((kind_of[panel_owner], np.full(len(walls_m), ObjectKind.FLAT, np.uint8))),
            np.concatenate((panel_owner, np.full(len(walls_m), -1, np.int32))),
        ),
    )


def _objects(wires: Wires, fronts: Fronts, config: SurfaceConfig) -> IntArray:
    """(P + L + F,) the object of each upright edge, level edge and front, counted from 0; flat fronts come last."""
    posts_m, rails_m = wires.posts_m, wires.rails_m
    posts, rails = len(posts_m), len(rails_m)
    a, b = near_pairs(rails_m.reshape(-1, 3), rails_m.reshape(-1, 3), config.join_m)
    c, d = near_pairs(rails_m.reshape(-1, 3), posts_m[:, 1], config.join_m)
    known = ~np.isnan(fronts.heights_m)
    node_of = posts + rails + np.where(known, np.cumsum(known) - 1, known.sum() + np.cumsum(~known) - 1)
    first = np.concatenate((posts + a // 2, posts + c // 2, node_of[fronts.rails[:, 0]], node_of[fronts.posts[:, 0]]))
    second = np.concatenate((posts + b // 2, d, posts + fronts.rails[:, 1], fronts.posts[:, 1]))
    count = posts + rails + len(known)
    graph = coo_matrix((np.ones(len(first)), (first, second)), (count, count))
    owner = connected_components(graph, directed=False)[1]
    return np.asarray(np.concatenate((owner[: posts + rails], owner[node_of])), np.int64)


def _top_faces(rails_m: FloatArray, owner: IntArray, config: SurfaceConfig) -> tuple[FloatArray, IntArray]:
    """(T, 4, 3) parallelograms between two level edges that meet at a corner, the largest first; each edge bounds one.

    And (T,) their objects.
    """
    i, j = near_pairs(rails_m.reshape(-1, 3), rails_m.reshape(-1, 3), config.join_m)
    pairs = np.unique(np.column_stack((i // 2, j // 2))[i // 2 < j // 2], axis=0)
    faces_m, sine = _faces(rails_m[pairs[:, 0]], rails_m[pairs[:, 1]])
    cornered = (owner[pairs[:, 0]] == owner[pairs[:, 1]]) & (sine >= _CORNER_SINE)
    pairs, faces_m = pairs[cornered], faces_m[cornered]
    u, v = faces_m[:, 1] - faces_m[:, 0], faces_m[:, 3] - faces_m[:, 0]
    area_m2 = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    used: set[int] = set()
    chosen: list[int] = []
    for k in np.lexsort((pairs[:, 1], pairs[:, 0], -area_m2)).tolist():
        edges = set(pairs[k].tolist())
        if not edges & used:
            used |= edges
            chosen.append(k)
    return faces_m[chosen], owner[pairs[chosen, 0]]


def _faces(a_m: FloatArray, b_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(K, 4, 3) spanned by two edges, (K, 2, 3) each, from where they meet, and (K,) the sine of the corner there."""
    rows = np.arange(len(a_m))
    gap_m = np.abs(a_m[:, :, None] - b_m[:, None]).sum(axis=3)
    i, j = np.divmod(gap_m.reshape(-1, 4).argmin(axis=1), 2)
    corner_m = a_m[rows, i]
    u, v = a_m[rows, 1 - i] - corner_m, b_m[rows, 1 - j] - b_m[rows, j]
    sine = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    sine /= np.maximum(np.hypot(u[:, 0], u[:, 1]) * np.hypot(v[:, 0], v[:, 1]), 1e-12)
    return np.stack((corner_m, corner_m + u, corner_m + u + v, corner_m + v), axis=1), sine


def _upright(ends_m: FloatArray, heights_m: FloatArray) -> FloatArray:
    """(K, 4, 3) over pieces of line, (K, 2, 2), from the floor on."""
    corners_m = np.zeros((len(ends_m), 4, 3))
    corners_m[:, :, :2] = ends_m[:, [0, 1, 1, 0]]
    corners_m[:, 2:, 2] = heights_m[:, None]
    return corners_m
