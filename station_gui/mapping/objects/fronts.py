"""Upright surfaces: straight pieces of the 2D map, and how high they are.

The 2D map says where a front begins and ends, the edges over it how high it is. Where no edge tells, the front is flat.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.objects.config import SurfaceConfig
from station_gui.mapping.objects.reference import coordinates, directions
from station_gui.mapping.objects.wires import Wires

FloatArray = NDArray[np.float64]

_NEAR_M = 0.04  # an edge so near a line stands on it
_SHORTEST_M = 0.03
_LEVEL_M = 0.04  # fronts beside one another whose heights differ by less are one


@dataclass(frozen=True, slots=True, eq=False)
class Front:
    """`ends_m`: (2, 2) from above; `height_m` is not a number where nothing tells.

    `rails`, `posts`: the edges on it. `capped`: whether a level edge lies along its top. `corners`: (2,) whether it
    ends where nothing hides it from the 2D scanner and the level edge ends too.
    """

    ends_m: FloatArray
    height_m: float
    rails: frozenset[int]
    posts: frozenset[int]
    capped: bool
    corners: tuple[bool, bool]


def fronts_of(lines_m: FloatArray, wires: Wires, config: SurfaceConfig) -> list[Front]:
    """Along each line, (R, 2, 2)."""
    if len(lines_m) == 0:
        return []
    along, length_m = directions(lines_m)
    posts_at, posts_off = coordinates(wires.posts_m[:, 0, :2], lines_m, along)
    rails_at, rails_off = coordinates(wires.rails_m[:, :, :2].reshape(-1, 2), lines_m, along)
    rails_at, rails_off = rails_at.reshape(-1, 2, len(lines_m)), rails_off.reshape(-1, 2, len(lines_m))
    posts_near = (np.abs(posts_off) <= _NEAR_M) & (posts_at > -config.join_m) & (posts_at < length_m + config.join_m)
    rails_near = (
        (np.abs(rails_off).max(axis=1) <= _NEAR_M) & (rails_at.min(axis=1) < length_m) & (rails_at.max(axis=1) > 0)
    )
    bare = ~(posts_near.any(axis=0) | rails_near.any(axis=0))
    fronts = [_flat(line_m) for line_m in lines_m[bare]]
    heights_m = wires.heights_m().tolist()
    for r in np.flatnonzero(~bare).tolist():
        posts, rails = np.flatnonzero(posts_near[:, r]), np.flatnonzero(rails_near[:, r])
        line = _Line(
            lines_m[r, 0],
            along[r],
            float(length_m[r]),
            [
                _Post(p, at, z0 <= config.floor_m, z1)
                for p, at, (z0, z1) in zip(
                    posts.tolist(), posts_at[posts, r].tolist(), wires.posts_m[posts, :, 2].tolist(), strict=True
                )
            ],
            [
                _Rail(k, min(ends), max(ends), heights_m[k])
                for k, ends in zip(rails.tolist(), rails_at[rails, :, r].tolist(), strict=True)
            ],
        )
        fronts += line.fronts(config.join_m)
    return fronts


def _flat(ends_m: FloatArray) -> Front:
    return Front(ends_m, math.nan, frozenset(), frozenset(), capped=False, corners=(False, False))


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

    def fronts(self, join_m: float) -> list[Front]:
        """From one end to the other; neighbours of the same height are one."""
        cuts = self._cuts(join_m)
        found: list[Front] = []
        for low, high in itertools.pairwise(cuts):
            if high - low < _SHORTEST_M:
                continue
            front = self._front(low, high, join_m)
            if found and _continues(found[-1], front):
                front = _together(found.pop(), front)
            found.append(front)
        return found

    def _front(self, low: float, high: float, join_m: float) -> Front:
        middle = (low + high) / 2
        over = [rail for rail in self.rails if rail.low_m <= middle <= rail.high_m]
        left = [post for post in self.posts if abs(post.at_m - low) <= join_m]
        right = [post for post in self.posts if abs(post.at_m - high) <= join_m]
        height_m, corners = math.nan, (False, False)
        if over:
            height_m = max(rail.height_m for rail in over)
            tops = [rail for rail in over if rail.height_m > height_m - _LEVEL_M]
            corners = (
                low <= join_m and any(abs(rail.low_m - low) <= 2 * join_m for rail in tops),
                high >= self.length_m - join_m and any(abs(rail.high_m - high) <= 2 * join_m for rail in tops),
            )
        elif any(post.stands for post in left) and any(post.stands for post in right):
            height_m = min(max(post.top_m for post in side) for side in (left, right))
        return Front(
            self.start_m + np.array([[low], [high]]) * self.along,
            height_m,
            frozenset(rail.index for rail in over),
            frozenset(post.index for post in (*left, *right)),
            len(over) > 0,
            corners,
        )

    def _cuts(self, join_m: float) -> list[float]:
        """Where the line is cut: at upright edges, at its ends and at the ends of level edges; the first ones count."""
        wanted = [post.at_m for post in self.posts]
        wanted += [0.0, self.length_m]
        wanted += [end for rail in self.rails for end in (rail.low_m, rail.high_m) if 0.0 < end < self.length_m]
        cuts: list[float] = []
        for at in wanted:
            if all(abs(at - other) > join_m / 2 for other in cuts):
                cuts.append(at)
        return sorted(cuts)


def _continues(a: Front, b: Front) -> bool:
    if math.isnan(a.height_m) or math.isnan(b.height_m):
        return math.isnan(a.height_m) and math.isnan(b.height_m)
    return bool(a.rails & b.rails) and abs(a.height_m - b.height_m) <= _LEVEL_M


def _together(a: Front, b: Front) -> Front:
    return Front(
        np.array([a.ends_m[0], b.ends_m[1]]),
        max(a.height_m, b.height_m),
        a.rails | b.rails,
        a.posts | b.posts,
        a.capped and b.capped,
        (a.corners[0], b.corners[1]),
    )
