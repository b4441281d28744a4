"""From edges to objects with surfaces (paper 1, figure 11): upright panels, top faces, and which belong together."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from station_gui.mapping.objects.config import ReferenceConfig, SurfaceConfig
from station_gui.mapping.objects.flat_walls import FlatWalls
from station_gui.mapping.objects.fronts import Front, fronts_of
from station_gui.mapping.objects.fusing.fused_edges import Edges
from station_gui.mapping.objects.kinds import kinds_of
from station_gui.mapping.objects.ransac.ransac import LineFitter
from station_gui.mapping.objects.wires import Wires, near_pairs, standing, tidied, without_chords
from station_gui.mapping.snapshot import NO_OBJECTS, ObjectKind, ObjectMap, Panels

FloatArray = NDArray[np.float64]

_CORNER_SINE = 0.7  # two level edges that meet so make the corner of a top face


class ObjectBuilder:
    """A function of what it is given; it only remembers what need not be worked out again."""

    def __init__(self, config: SurfaceConfig, reference: ReferenceConfig, fitter: LineFitter) -> None:
        self._config = config
        self._flat = FlatWalls(config, reference, fitter)

    def without_reference(self, edges: Edges) -> ObjectMap:
        """Edges alone, as they were fused."""
        return _assembled(tidied(edges, self._config, with_floor=True), [], self._config)

    def build(self, edges: Edges, reference_m: FloatArray, nodes_m: FloatArray, cell_m: float) -> ObjectMap:
        """`reference_m`: (R, 2, 2) of step 4, `nodes_m`: (N, 2) occupied cells."""
        lines_m = np.concatenate((reference_m, self._flat.lines_m(nodes_m, reference_m, cell_m)))
        wires = tidied(edges, self._config, with_floor=False)
        wires = standing(without_chords(wires, lines_m, self._config), nodes_m, self._config)
        return _assembled(wires, fronts_of(lines_m, wires, self._config), self._config)


def _assembled(wires: Wires, fronts: list[Front], config: SurfaceConfig) -> ObjectMap:
    known = [front for front in fronts if not math.isnan(front.height_m)]
    flat = [front for front in fronts if math.isnan(front.height_m)]
    posts, rails = len(wires.posts_m), len(wires.rails_m)
    if posts + rails + len(fronts) == 0:
        return NO_OBJECTS
    owner = _objects(wires, known, config)
    more, more_owner = _outlines(known, owner[posts + rails :], wires, config)
    ends_m = np.concatenate((wires.posts_m, wires.rails_m, more))
    cluster = np.concatenate((owner[: posts + rails], more_owner)).astype(np.int32)
    kinds = kinds_of(ends_m, cluster, config)
    kind_of = np.zeros(int(owner.max(initial=-1)) + 1, np.uint8)
    kind_of[cluster] = kinds
    tops, tops_owner = _top_faces(wires.rails_m, owner[posts : posts + rails], config)
    upright = [_upright(front.ends_m, front.height_m) for front in known]
    walls = [_upright(front.ends_m, config.wall_height_m) for front in flat]
    corners_m = np.array([*upright, *tops, *walls], np.float32).reshape(-1, 4, 3)
    panel_owner = np.concatenate((owner[posts + rails :], tops_owner)).astype(np.int32)
    nobody = np.full(len(walls), -1, np.int32)
    return ObjectMap(
        ends_m.astype(np.float32),
        kinds,
        cluster,
        Panels(
            corners_m,
            np.concatenate((kind_of[panel_owner], np.full(len(walls), ObjectKind.FLAT, np.uint8))),
            np.concatenate((panel_owner, nobody)),
        ),
    )


def _objects(wires: Wires, fronts: list[Front], config: SurfaceConfig) -> NDArray[np.int64]:
    """(P + L + F,) the object of each upright edge, level edge and front, counted from 0."""
    posts_m, rails_m, join_m = wires.posts_m, wires.rails_m, config.join_m
    posts, rails = len(posts_m), len(rails_m)
    pairs: list[tuple[int, int]] = []
    if rails:
        a, b = near_pairs(rails_m.reshape(-1, 3), rails_m.reshape(-1, 3), join_m)
        pairs += zip((posts + a // 2).tolist(), (posts + b // 2).tolist(), strict=True)
    if rails and posts:
        a, b = near_pairs(rails_m.reshape(-1, 3), posts_m[:, 1], join_m)
        pairs += zip((posts + a // 2).tolist(), b.tolist(), strict=True)
    for k, front in enumerate(fronts):
        pairs += [(posts + rails + k, posts + rail) for rail in sorted(front.rails)]
        level = [post for post in sorted(front.posts) if abs(posts_m[post, 1, 2] - front.height_m) <= join_m]
        pairs += [(posts + rails + k, post) for post in level]
    count = posts + rails + len(fronts)
    a, b = np.array(pairs, np.int64).reshape(-1, 2).T
    return np.asarray(connected_components(coo_matrix((np.ones(len(a)), (a, b)), (count, count)), directed=False)[1])


def _outlines(
    fronts: list[Front], owner: NDArray[np.int64], wires: Wires, config: SurfaceConfig
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Edges of fronts that no camera saw: on the floor, between two upright ones, and at a corner of the 2D map."""
    found: list[FloatArray] = []
    owners: list[int] = []
    for front, number in zip(fronts, owner.tolist(), strict=True):
        bottom = np.column_stack((front.ends_m, np.zeros(2)))
        top = np.column_stack((front.ends_m, np.full(2, front.height_m)))
        edges = [bottom] if front.capped else [bottom, top]
        for end in range(2):
            beside = np.hypot(*(wires.posts_m[:, 0, :2] - front.ends_m[end]).T)
            if front.corners[end] and not (beside <= config.join_m).any():
                edges.append(np.array([bottom[end], top[end]]))
        found += edges
        owners += [number] * len(edges)
    return np.array(found).reshape(-1, 2, 3), np.array(owners, np.int64)


def _top_faces(
    rails_m: FloatArray, owner: NDArray[np.int64], config: SurfaceConfig
) -> tuple[list[FloatArray], NDArray[np.int64]]:
    """A parallelogram between two level edges that meet at a corner, the largest first; each edge bounds one."""
    found: list[tuple[float, int, int, FloatArray]] = []
    i, j = near_pairs(rails_m.reshape(-1, 3), rails_m.reshape(-1, 3), config.join_m)
    for a, b in sorted({(a, b) for a, b in zip((i // 2).tolist(), (j // 2).tolist(), strict=True) if a < b}):
        face = _face(rails_m[a], rails_m[b])
        if owner[a] == owner[b] and face is not None:
            (ux, uy, _), (vx, vy, _) = (face[1] - face[0]).tolist(), (face[3] - face[0]).tolist()
            found.append((-abs(ux * vy - uy * vx), a, b, face))
    used: set[int] = set()
    faces: list[FloatArray] = []
    owners: list[int] = []
    for _, a, b, face in sorted(found, key=lambda item: item[:3]):
        if not {a, b} & used:
            used |= {a, b}
            faces.append(face)
            owners.append(int(owner[a]))
    return faces, np.array(owners, np.int64)


def _face(a: FloatArray, b: FloatArray) -> FloatArray | None:
    """Spanned by two edges from where they meet; None where they do not make a corner."""
    gap_m = np.abs(a[:, None] - b[None]).sum(axis=2)
    i, j = divmod(int(gap_m.argmin()), 2)
    u, v = a[1 - i] - a[i], b[1 - j] - b[j]
    if abs(u[0] * v[1] - u[1] * v[0]) < _CORNER_SINE * math.hypot(u[0], u[1]) * math.hypot(v[0], v[1]):
        return None
    return np.array([a[i], a[i] + u, a[i] + u + v, a[i] + v])


def _upright(ends_m: FloatArray, height_m: float) -> FloatArray:
    (ax, ay), (bx, by) = ends_m.tolist()
    return np.array([[ax, ay, 0.0], [bx, by, 0.0], [bx, by, height_m], [ax, ay, height_m]])
