"""Outlines of objects, and how much of one lies along another."""

from __future__ import annotations

from dataclasses import dataclass

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

    def reach_m(self, config: TrackingConfig) -> float:
        """What is so near it may be the same thing."""
        return max(config.reach_m, config.reach_per_m * self.distance_m)

    def apparent_size(self) -> float:
        """Its length by how far it is."""
        return self.length_m / self.distance_m


def outlines_of(objects: ObjectNetwork, odom_from_robot: Pose2) -> list[Outline]:
    """The clusters of a network in the robot's frame; nodes without a connection are none."""
    if len(objects.edges) == 0:
        return []
    cluster_of, edges = clusters(objects), objects.edges.astype(np.int32)
    by_node, by_edge = np.argsort(cluster_of, kind="stable"), np.argsort(cluster_of[edges[:, 0]], kind="stable")
    sizes = np.bincount(cluster_of)
    edge_counts = np.bincount(cluster_of[edges[:, 0]], minlength=len(sizes))
    first, first_edge = np.cumsum(sizes) - sizes, np.cumsum(edge_counts) - edge_counts
    place = np.empty(len(by_node), np.int32)
    place[by_node] = np.arange(len(by_node), dtype=np.int32)

    nodes_m = odom_from_robot.apply_3d(objects.nodes_m[by_node])
    connections = place[edges[by_edge]]
    segments_m = nodes_m[connections]
    connections -= np.repeat(first, edge_counts).astype(np.int32)[:, None]
    length_m = np.linalg.norm(segments_m[:, 1] - segments_m[:, 0], axis=1)
    distance_m = np.bincount(cluster_of, np.linalg.norm(objects.nodes_m, axis=1)) / sizes
    return [
        Outline(
            nodes_m[a : a + size],
            connections[b : b + count],
            segments_m[b : b + count],
            float(length_m[b : b + count].sum()),
            distance,
        )
        for a, size, b, count, distance in zip(
            first.tolist(), sizes.tolist(), first_edge.tolist(), edge_counts.tolist(), distance_m.tolist(), strict=True
        )
        if count > 0
    ]


def shares_near(outlines: list[Outline], others: list[Outline], config: TrackingConfig) -> FloatArray:
    """(K, L): which share of each outline lies near each of the others."""
    if not outlines or not others:
        return np.zeros((len(outlines), len(others)))
    segments_m, start = _joined(outlines)
    other_m, other_start = (segments_m, start) if others is outlines else _joined(others)
    shares: FloatArray = np.zeros((len(outlines), len(others)))
    kernels.measure_overlap(
        segments_m,
        start,
        other_m,
        other_start,
        np.array([other.reach_m(config) for other in others]),
        config.step_m,
        np.zeros((len(outlines), 2, 3)),
        np.zeros((len(others), 2, 3)),
        shares,
    )
    return shares


def snapped(new: Outline, known: Outline, config: TrackingConfig) -> Outline:
    """The new outline, with nodes where the known one has them when these are as good as the same."""
    gap_m = np.linalg.norm(new.nodes_m[:, None] - known.nodes_m[None], axis=2)
    nodes_m = new.nodes_m.copy()
    nearest, back = np.argmin(gap_m, axis=1), np.argmin(gap_m, axis=0)
    for a, b in enumerate(nearest.tolist()):
        if gap_m[a, b] < new.reach_m(config) and back[b] == a:
            nodes_m[a] = known.nodes_m[b]
    return Outline.of(nodes_m, new.connections, min(new.distance_m, known.distance_m))


def _joined(outlines: list[Outline]) -> tuple[FloatArray, NDArray[np.int32]]:
    segments_m = np.concatenate([outline.segments_m for outline in outlines])
    start = np.zeros(len(outlines) + 1, np.int32)
    np.cumsum([len(outline.connections) for outline in outlines], out=start[1:])
    return segments_m, start
