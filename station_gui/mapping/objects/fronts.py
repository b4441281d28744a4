"""Upright surfaces: straight pieces of the 2D map, and how high they are.

The 2D map says where a front begins and ends, the edges over it how high it is. Where no edge tells, the front is flat.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.objects.config import SurfaceConfig
from station_gui.mapping.objects.reference import coordinates, directions
from station_gui.mapping.objects.wires import Wires

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_NEAR_M = 0.04  # an edge so near a line stands on it
_SHORTEST_M = 0.03
_LEVEL_M = 0.04  # fronts beside one another whose heights differ by less are one
_NO_PAIRS = np.zeros((0, 2), np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class Fronts:
    """`ends_m`: (F, 2, 2) from above; `heights_m`: (F,), not a number where nothing tells.

    `rails`, `posts`: (K, 2), a front and the index of an edge that is of the same object. `outlines_m`: (O, 2, 3) edges
    of fronts that no camera saw: on the floor and at a corner of the 2D map; `outline_of`: (O,) the front of each. The
    tops of two upright ones are joined by none: of something tall they are where the image ends.
    """

    ends_m: FloatArray
    heights_m: FloatArray
    rails: IntArray
    posts: IntArray
    outlines_m: FloatArray
    outline_of: IntArray


class FrontFinder:
    """Along each line of the 2D map. A line whose edges are as they were is not looked at again."""

    def __init__(self, config: SurfaceConfig) -> None:
        self._config = config
        self._known: dict[bytes, Fronts] = {}

    def fronts_of(self, lines_m: FloatArray, wires: Wires) -> Fronts:
        """One line, (R, 2, 2), after the other."""
        reach_m = max(_NEAR_M, self._config.join_m)
        along, length_m = directions(lines_m)
        posts_at, posts_off = coordinates(wires.posts_m[:, 0, :2], lines_m, along)
        rails_at, rails_off = coordinates(wires.rails_m[:, :, :2].reshape(-1, 2), lines_m, along)
        shape = len(wires.rails_m), 2, len(lines_m)
        rails_at, rails_off = rails_at.reshape(shape), rails_off.reshape(shape)
        posts_near = (np.abs(posts_off) <= reach_m) & (posts_at > -reach_m) & (posts_at < length_m + reach_m)
        rails_near = (
            (np.abs(rails_off).max(axis=1) <= _NEAR_M) & (rails_at.min(axis=1) < length_m) & (rails_at.max(axis=1) > 0)
        )
        post_of, rail_of = _Listed.of(posts_near), _Listed.of(rails_near)
        posts_m, rails_m = wires.posts_m[post_of.index], wires.rails_m[rail_of.index]
        now: dict[bytes, Fronts] = {}
        found: list[Fronts] = []
        bounds = zip(lines_m, post_of.slices(), rail_of.slices(), strict=True)
        for line_m, posts, rails in bounds:
            here = Wires(posts_m[posts], rails_m[rails])
            key = len(here.posts_m).to_bytes(4) + line_m.tobytes() + here.posts_m.tobytes() + here.rails_m.tobytes()
            known = self._known.get(key)
            now[key] = self._along(line_m, here) if known is None else known
            found.append(now[key])
        self._known = now
        return _in_a_row(found, post_of, rail_of)

    def _along(self, line_m: FloatArray, wires: Wires) -> Fronts:
        """`wires`: the edges at this line, (2, 2), alone."""
        along, length_m = directions(line_m[None])
        posts_at, posts_off = (
            each[:, 0].tolist() for each in coordinates(wires.posts_m[:, 0, :2], line_m[None], along)
        )
        rails_at = coordinates(wires.rails_m[:, :, :2].reshape(-1, 2), line_m[None], along)[0].reshape(-1, 2).tolist()
        line = _Line(
            line_m[0],
            along[0],
            float(length_m[0]),
            [
                _Post(p, at, z0 <= self._config.floor_m, z1)
                for p, (at, off, (z0, z1)) in enumerate(
                    zip(posts_at, posts_off, wires.posts_m[:, :, 2].tolist(), strict=True)
                )
                if abs(off) <= _NEAR_M
            ],
            [
                _Rail(k, min(ends), max(ends), height_m)
                for k, (ends, height_m) in enumerate(zip(rails_at, wires.heights_m().tolist(), strict=True))
            ],
        )
        return _arrays(line.fronts(self._config.join_m), wires.posts_m, self._config.join_m)


@dataclass(frozen=True, slots=True, eq=False)
class _Front:
    """`rails`, `posts`: the edges on it.

    `corners`: (2,) whether it ends where nothing hides it from the 2D scanner and the level edge ends too.
    """

    ends_m: FloatArray
    height_m: float
    rails: frozenset[int]
    posts: frozenset[int]
    corners: tuple[bool, bool]

    def outlines_m(self, posts_m: FloatArray, join_m: float) -> list[FloatArray]:
        """(2, 3) each, the edges that no camera saw."""
        bottom = np.column_stack((self.ends_m, np.zeros(2)))
        top = np.column_stack((self.ends_m, np.full(2, self.height_m)))
        edges = [bottom]
        for end in range(2):
            beside = np.hypot(*(posts_m[:, 0, :2] - self.ends_m[end]).T)
            if self.corners[end] and not (beside <= join_m).any():
                edges.append(np.array([bottom[end], top[end]]))
        return edges


def _arrays(fronts: list[_Front], posts_m: FloatArray, join_m: float) -> Fronts:
    known = [(k, front) for k, front in enumerate(fronts) if not math.isnan(front.height_m)]
    rails = [(k, rail) for k, front in known for rail in sorted(front.rails)]
    posts = [
        (k, post)
        for k, front in known
        for post in sorted(front.posts)
        if abs(posts_m[post, 1, 2] - front.height_m) <= join_m
    ]
    outlines = [(k, edge) for k, front in known for edge in front.outlines_m(posts_m, join_m)]
    return Fronts(
        np.array([front.ends_m for front in fronts]).reshape(-1, 2, 2),
        np.array([front.height_m for front in fronts]),
        np.array(rails, np.int64).reshape(-1, 2),
        np.array(posts, np.int64).reshape(-1, 2),
        np.array([edge for _, edge in outlines]).reshape(-1, 2, 3),
        np.array([k for k, _ in outlines], np.int64),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Listed:
    """Which edges are at each line: those of one line after those of another. `first`: (R + 1,) where each begins."""

    index: IntArray
    first: IntArray

    @staticmethod
    def of(near: NDArray[np.bool_]) -> _Listed:
        """(edges, lines)."""
        line, index = np.nonzero(near.T)
        return _Listed(index, np.searchsorted(line, np.arange(near.shape[1] + 1)))

    def slices(self) -> Iterator[slice]:
        return (slice(low, high) for low, high in itertools.pairwise(self.first.tolist()))

    def in_map(self, pairs: list[IntArray], first_front: IntArray) -> IntArray:
        """(K, 2) of each line's own fronts and edges, numbered as in the whole map."""
        line = np.repeat(np.arange(len(pairs)), [len(each) for each in pairs])
        front, edge = np.concatenate([_NO_PAIRS, *pairs]).T
        return np.column_stack((front + first_front[line], self.index[edge + self.first[line]]))


def _in_a_row(parts: list[Fronts], posts: _Listed, rails: _Listed) -> Fronts:
    first = np.cumsum([0, *(len(part.heights_m) for part in parts)])
    outline_line = np.repeat(np.arange(len(parts)), [len(part.outline_of) for part in parts])
    return Fronts(
        np.concatenate([np.zeros((0, 2, 2)), *(part.ends_m for part in parts)]),
        np.concatenate([np.zeros(0), *(part.heights_m for part in parts)]),
        rails.in_map([part.rails for part in parts], first),
        posts.in_map([part.posts for part in parts], first),
        np.concatenate([np.zeros((0, 2, 3)), *(part.outlines_m for part in parts)]),
        np.concatenate([_NO_PAIRS[:, 0], *(part.outline_of for part in parts)]) + first[outline_line],
    )


@dataclass(frozen=True, slots=True)
class _Post:
    """An upright edge on a line."""

    index: int
    at_m: float
    stands: bool
    top_m: float


@dataclass(frozen=True, slots=True)
class _Rail:
    """A level edge along a line."""

    index: int
    low_m: float
    high_m: float
    height_m: float


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    start_m: FloatArray
    along: FloatArray
    length_m: float
    posts: list[_Post]
    rails: list[_Rail]

    def fronts(self, join_m: float) -> list[_Front]:
        """From one end to the other; neighbours of the same height are one."""
        bounds = self._bounds(2 * join_m)
        cuts = self._cuts(bounds, join_m)
        found: list[_Front] = []
        for low, high in itertools.pairwise(cuts):
            if high - low < _SHORTEST_M:
                continue
            front = self._front(low, high, bounds, join_m)
            if found and _continues(found[-1], front):
                front = _together(found.pop(), front)
            found.append(front)
        return found

    def _bounds(self, reach_m: float) -> tuple[float, float]:
        """A front goes as far as its cells do, or as a level edge over it: each was seen so far at least."""
        lows = [rail.low_m for rail in self.rails if -reach_m <= rail.low_m < 0.0]
        highs = [rail.high_m for rail in self.rails if self.length_m < rail.high_m <= self.length_m + reach_m]
        return min([0.0, *lows]), max([self.length_m, *highs])

    def _front(self, low: float, high: float, bounds: tuple[float, float], join_m: float) -> _Front:
        middle = (low + high) / 2
        over = [rail for rail in self.rails if rail.low_m <= middle <= rail.high_m]
        left = [post for post in self.posts if abs(post.at_m - low) <= join_m]
        right = [post for post in self.posts if abs(post.at_m - high) <= join_m]
        height_m, corners = math.nan, (False, False)
        if over:
            height_m = max(rail.height_m for rail in over)
            tops = [rail for rail in over if rail.height_m > height_m - _LEVEL_M]
            corners = (
                low <= bounds[0] + join_m and any(abs(rail.low_m - low) <= 2 * join_m for rail in tops),
                high >= bounds[1] - join_m and any(abs(rail.high_m - high) <= 2 * join_m for rail in tops),
            )
        elif any(post.stands for post in left) and any(post.stands for post in right):
            height_m = min(max(post.top_m for post in side) for side in (left, right))
        return _Front(
            self.start_m + np.array([[low], [high]]) * self.along,
            height_m,
            frozenset(rail.index for rail in over),
            frozenset(post.index for post in (*left, *right)),
            corners,
        )

    def _cuts(self, bounds: tuple[float, float], join_m: float) -> list[float]:
        """Where the line is cut: at upright edges, at its ends and at the ends of level edges; the first ones count."""
        wanted = [post.at_m for post in self.posts]
        wanted += bounds
        wanted += [end for rail in self.rails for end in (rail.low_m, rail.high_m) if bounds[0] < end < bounds[1]]
        cuts: list[float] = []
        for at in wanted:
            if all(abs(at - other) > join_m / 2 for other in cuts):
                cuts.append(at)
        return sorted(cuts)


def _continues(a: _Front, b: _Front) -> bool:
    if math.isnan(a.height_m) or math.isnan(b.height_m):
        return math.isnan(a.height_m) and math.isnan(b.height_m)
    return bool(a.rails & b.rails) and abs(a.height_m - b.height_m) <= _LEVEL_M


def _together(a: _Front, b: _Front) -> _Front:
    return _Front(
        np.array([a.ends_m[0], b.ends_m[1]]),
        max(a.height_m, b.height_m),
        a.rails | b.rails,
        a.posts | b.posts,
        (a.corners[0], b.corners[1]),
    )
