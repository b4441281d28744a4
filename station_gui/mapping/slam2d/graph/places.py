"""Surroundings of nodes that the robot may have come back to."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Generator
from dataclasses import dataclass, field

import numpy as np

from station_gui.mapping.slam2d.config import LocalMapConfig, LoopConfig
from station_gui.mapping.slam2d.graph.pose_graph import PoseGraph
from station_gui.mapping.slam2d.graph.sight.sight import Horizon, View
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.matching.local_map import LocalMap
from station_gui.mapping.slam2d.matching.scan_matcher import ScanMatcher
from station_gui.mapping.slam2d.se2_arrays import between, compose
from station_gui.mapping.slam2d.search.branch_and_bound import Pyramid, fill_pyramid
from station_gui.mapping.slam2d.share import Share


@dataclass(slots=True, eq=False)
class Place:
    """A node's surroundings in its own frame. `views`: some of the scans that it was drawn from."""

    local_map: LocalMap
    views: list[View] = field(default_factory=list)
    pyramid: Pyramid | None = None


class Places:
    """Draws places a share at a time and keeps the last few; maps are used again, for clearing costs less."""

    def __init__(self, config: LoopConfig, map_config: LocalMapConfig, matcher: ScanMatcher, share: Share) -> None:
        self._config = config
        self._map_config = map_config
        self._matcher = matcher
        self._share = share
        self._places: OrderedDict[int, Place] = OrderedDict()
        self._spare = [self._new_map() for _ in range(config.cached_places)]  # now, when nobody waits
        self._in_use: Place | None = None

    def forget(self) -> None:
        """The nodes have moved against each other. The place in use stays as it is until it is let go."""
        self._spare.extend(place.local_map for place in self._places.values() if place is not self._in_use)
        self._places.clear()

    def let_go(self) -> None:
        """The place that was drawn last is not in use any more."""
        place, self._in_use = self._in_use, None
        if place is not None and all(place is not other for other in self._places.values()):
            self._spare.append(place.local_map)

    def draw(self, graph: PoseGraph, by_node: list[list[Keyframe]], node: int) -> Generator[None, None, Place]:
        """The place of `node`, as the graph is when this begins; `let_go` ends its use."""
        if node in self._places:
            self._places.move_to_end(node)
            self._in_use = self._places[node]
            return self._in_use
        self._in_use = place = Place(self._any_map())
        self._places[node] = place
        reach = self._config.neighbours
        waiting = [
            (between(graph.poses[node], graph.poses[k]), by_node[k][:])
            for k in range(max(0, node - reach), min(len(by_node), node + reach + 1))
        ]
        yield from place.local_map.clear_slowly(0.0, 0.0, self._share)
        for node_from_k, keyframes in waiting:
            for index, keyframe in enumerate(keyframes):
                if self._share.left <= 0:
                    yield
                pose = compose(node_from_k, keyframe.in_node)
                if index % self._config.view_every == 0:
                    place.views.append(View(pose, Horizon(keyframe)))
                self._share.take(place.local_map.insert(keyframe.points_m, keyframe.normals, pose))
        return place

    def raise_pyramid(self, place: Place) -> Generator[None, None, Pyramid]:
        if place.pyramid is None:
            local_map = place.local_map
            factor = max(1, round(self._config.cell_m / local_map.cell_m))
            side = len(local_map.distance2) // factor
            levels = np.zeros((self._config.levels + 1, side, side), np.uint8)
            yield from self._matcher.fill_likelihood(local_map, levels[0], self._share)
            origin_m = local_map.origin_x_m, local_map.origin_y_m
            pyramid = Pyramid(levels, origin_m, factor * local_map.cell_m)
            yield from fill_pyramid(pyramid, self._share)
            place.pyramid = pyramid
        return place.pyramid

    def _any_map(self) -> LocalMap:
        """To be cleared: one not needed any more, that of the place not needed for longest, or a new one."""
        if self._spare:
            return self._spare.pop()
        if len(self._places) >= self._config.cached_places:
            return self._places.popitem(last=False)[1].local_map
        return self._new_map()

    def _new_map(self) -> LocalMap:
        config = self._map_config
        return LocalMap(
            config.size_m, config.cell_m, config.reach_cells, self._config.max_place_surfels, config.max_count
        )
