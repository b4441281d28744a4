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
    """Nodes (N, 3), odom frame, and connections (M, 2) of one object; how far it was when it was seen."""

    nodes_m: FloatArray
    connections: NDArray[np.int32]
    distance_m: float

    def segments_m(self) -> FloatArray:
        """(M, 2, 3)"""
        picked: FloatArray = self.nodes_m[self.connections]
        return picked

    def length_m(self) -> float:
        ends = self.segments_m()
        return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum())

    def reach_m(self, config: TrackingConfig) -> float:
        """What is so near it may be the same thing."""
        return max(config.reach_m, config.reach_per_m * self.distance_m)


def outlines_of(objects: ObjectNetwork, odom_from_robot: Pose2) -> list[Outline]:
    """The clusters of a network in the robot's frame."""
    if len(objects.edges) == 0:
        return []
    cluster_of = clusters(objects)
    nodes_m = odom_from_robot.apply_3d(objects.nodes_m)
    distance_m = np.linalg.norm(objects.nodes_m, axis=1)
    edges = objects.edges.astype(np.int32)
    found = []
    for cluster in range(int(cluster_of.max()) + 1):
        picked = np.flatnonzero(cluster_of == cluster)
        connections = edges[cluster_of[edges[:, 0]] == cluster]
        if len(connections):
            renumbered = np.searchsorted(picked, connections).astype(np.int32)
            found.append(Outline(nodes_m[picked], renumbered, float(distance_m[picked].mean())))
    return found


def shares_near(outlines: list[Outline], others: list[Outline], config: TrackingConfig) -> FloatArray:
    """(K, L): which share of each outline lies near each of the others."""
    if not outlines or not others:
        return np.zeros((len(outlines), len(others)))
    segments_m, start = _joined(outlines)
    other_m, other_start = _joined(others)
    total = np.zeros(len(outlines), np.int32)
    hits = np.zeros((len(outlines), len(others)), np.int32)
    kernels.count_overlap(
        segments_m,
        start,
        len(outlines),
        other_m,
        other_start,
        len(others),
        np.array([other.reach_m(config) for other in others]),
        config.step_m,
        np.zeros((len(others), 2, 3)),
        total,
        hits,
    )
    shares: FloatArray = hits / np.maximum(total, 1)[:, None]
    return shares


def snapped(new: Outline, known: Outline, config: TrackingConfig) -> Outline:
    """The new outline, with nodes where the known one has them when these are as good as the same."""
    gap_m = np.linalg.norm(new.nodes_m[:, None] - known.nodes_m[None], axis=2)
    nodes_m = new.nodes_m.copy()
    nearest, back = np.argmin(gap_m, axis=1), np.argmin(gap_m, axis=0)
    for a, b in enumerate(nearest.tolist()):
        if gap_m[a, b] < new.reach_m(config) and back[b] == a:
            nodes_m[a] = known.nodes_m[b]
    return Outline(nodes_m, new.connections, min(new.distance_m, known.distance_m))


def _joined(outlines: list[Outline]) -> tuple[FloatArray, NDArray[np.int32]]:
    segments_m = np.concatenate([outline.segments_m() for outline in outlines])
    start = np.cumsum([0, *(len(outline.connections) for outline in outlines)])
    return segments_m, start.astype(np.int32)
