"""Outlines of objects, and how much of one lies along another."""

from __future__ import annotations

import operator
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from robot_app.perception.config import TrackingConfig
from robot_app.perception.identity import _kernels as kernels
from robot_app.perception.object_extractor import clusters
from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """Nodes (N, 3), odom frame, and connections (M, 2) of one object, the ends of these (M, 2, 3) and their length in
    all; how far it was when it was seen."""

    nodes_m: FloatArray
    connections: NDArray[np.int32]
    segments_m: FloatArray
    length_m: float
    distance_m: float

    @staticmethod
    def of(nodes_m: FloatArray, connections: NDArray[np.int32], distance_m: float) -> Outline:
        segments_m = nodes_m[connections]
        ways_m = segments_m[:, 1] - segments_m[:, 0]
        length_m = float(np.sqrt(np.einsum("ij,ij->i", ways_m, ways_m)).sum())
        return Outline(nodes_m, connections, segments_m, length_m, distance_m)

    def apparent_size(self) -> float:
        """Its length by how far it is."""
        return self.length_m / self.distance_m


@dataclass(frozen=True, slots=True, eq=False)
class Outlines:
    """Some outlines as the kernels take them: `segments_m` (S, 2, 3), of all one after the other, `start` (K + 1,),
    where each begins there, and `reach_m` (K,): what is so near to one may be the same thing."""

    items: list[Outline]
    segments_m: FloatArray
    start: NDArray[np.int32]
    reach_m: FloatArray

    @staticmethod
    def of(items: list[Outline], config: TrackingConfig) -> Outlines:
        segments_m = np.concatenate([np.zeros((0, 2, 3)), *(item.segments_m for item in items)])
        return Outlines.joined(items, segments_m, config)

    @staticmethod
    def joined(items: list[Outline], segments_m: FloatArray, config: TrackingConfig) -> Outlines:
        """Of outlines whose segments are those, in this order."""
        start = np.array([0, *accumulate(len(item.connections) for item in items)], np.int32)
        distance_m = np.array([item.distance_m for item in items], np.float64)
        return Outlines(items, segments_m, start, np.maximum(config.reach_m, config.reach_per_m * distance_m))

    def same(self, items: list[Outline]) -> bool:
        """Whether these are the very same outlines in the same order."""
        return len(items) == len(self.items) and all(map(operator.is_, items, self.items))

    def shares_near(self, others: Outlines, step_m: float) -> FloatArray:
        """(K, L): which share of the points every `step_m` along each outline lies near each of the others."""
        shares: FloatArray = np.zeros((len(self.items), len(others.items)))
        kernels.measure_overlap(
            self.segments_m,
            self.start,
            others.segments_m,
            others.start,
            others.reach_m,
            step_m,
            np.zeros((len(self.items), 2, 3)),
            np.zeros((len(others.items), 2, 3)),
            shares,
        )
        return shares

    def mark_whole(self, keep_share: float, step_m: float) -> NDArray[np.uint8]:
        """(K,): 0 for those of which `keep_share` lies near one before them that is whole, 1 for these."""
        whole = np.zeros(len(self.items), np.uint8)
        boxes_m = np.zeros((len(self.items), 2, 3))
        kernels.mark_whole(self.segments_m, self.start, self.reach_m, keep_share, step_m, boxes_m, whole)
        return whole


def outlines_of(objects: ObjectNetwork, odom_from_robot: Pose2, config: TrackingConfig) -> Outlines:
    """The clusters of a network in the robot's frame; nodes without a connection are none."""
    if len(objects.edges) == 0:
        return Outlines.of([], config)
    cluster_of, edges = clusters(objects), objects.edges.astype(np.int32)
    edge_cluster = cluster_of[edges[:, 0]]
    by_node, by_edge = cluster_of.argsort(kind="stable"), edge_cluster.argsort(kind="stable")
    sizes = np.bincount(cluster_of)
    edge_counts = np.bincount(edge_cluster, minlength=len(sizes))
    first, first_edge = sizes.cumsum() - sizes, edge_counts.cumsum() - edge_counts
    place = np.empty(len(by_node), np.int32)
    place[by_node] = np.arange(len(by_node), dtype=np.int32)

    nodes_m = odom_from_robot.apply_3d(objects.nodes_m[by_node])
    connections = place[edges[by_edge]]
    segments_m = nodes_m[connections]
    connections -= first.repeat(edge_counts).astype(np.int32)[:, None]
    length_m = np.linalg.norm(segments_m[:, 1] - segments_m[:, 0], axis=1)
    outline_m = np.bincount(edge_cluster[by_edge], length_m, minlength=len(sizes))
    distance_m = np.bincount(cluster_of, np.linalg.norm(objects.nodes_m, axis=1)) / sizes
    columns = (first, sizes, first_edge, edge_counts, outline_m, distance_m)
    items = [
        Outline(nodes_m[a : a + size], connections[b : b + count], segments_m[b : b + count], length, distance)
        for a, size, b, count, length, distance in zip(*(column.tolist() for column in columns), strict=True)
        if count > 0
    ]
    return Outlines.joined(items, segments_m, config)


def snapped(new: Outline, known: Outline, config: TrackingConfig) -> Outline:
    """The new outline, with nodes where the known one has them when these are as good as the same."""
    gap_m = np.linalg.norm(new.nodes_m[:, None] - known.nodes_m[None], axis=2)
    near_m = max(config.reach_m, config.reach_per_m * new.distance_m)
    nodes_m = new.nodes_m.copy()
    nearest, back = np.argmin(gap_m, axis=1), np.argmin(gap_m, axis=0)
    for a, b in enumerate(nearest.tolist()):
        if gap_m[a, b] < near_m and back[b] == a:
            nodes_m[a] = known.nodes_m[b]
    return Outline.of(nodes_m, new.connections, min(new.distance_m, known.distance_m))
