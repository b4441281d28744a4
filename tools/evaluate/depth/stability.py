"""How much a network changes between two frames of a still scene, of which only the noise differs."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from robot_app.perception.config import PerceptionConfig
from robot_app.perception.identity.tracker import ObjectTracker
from robot_app.perception.object_extractor import ObjectExtractor
from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork
from tools.evaluate.depth.lab_frames import lab_camera, lab_frames

_SAME_M = 0.05  # a node of the next frame so near is the same


@dataclass(frozen=True, slots=True)
class Stability:
    """Of the nodes: the share that stays within 3 cm and the median way to the nearest node of the next frame; of the
    connections: the share of which both ends have such a node within 5 cm, and these are connected."""

    nodes_within_3_cm: float
    median_step_mm: float
    connections_kept: float


def measure_stability(frames: int = 8) -> tuple[Stability, Stability]:
    """On the views of the simulated lab: the networks as they are learned, and as the tracker hands them on."""
    intrinsics, mount = lab_camera()
    extractor = ObjectExtractor(PerceptionConfig(), intrinsics, mount)
    learned, tracked = [], []
    for view in zip(*(lab_frames(seed) for seed in range(1, frames + 1)), strict=True):
        networks = [extractor.extract(image) for image in view]
        tracker = ObjectTracker(PerceptionConfig().tracking)
        kept = [tracker.update(network, Pose2()) for network in networks]
        learned += [compare(a, b) for a, b in pairwise(networks)]
        tracked += [compare(a, b) for a, b in pairwise(kept)]
    return _mean(learned), _mean(tracked)


def compare(network: ObjectNetwork, following: ObjectNetwork) -> Stability:
    """How much of `network` there is in the network of the next frame."""
    if len(network.edges) == 0 or len(following.edges) == 0:
        same = len(network.edges) == len(following.edges)
        return Stability(float(same), 0.0, float(same))
    gap_m = np.linalg.norm(network.nodes_m[:, None] - following.nodes_m[None], axis=2)
    nearest, step_m = gap_m.argmin(axis=1), gap_m.min(axis=1)
    there = {frozenset(pair) for pair in following.edges.tolist()}
    kept = [
        max(step_m[a], step_m[b]) < _SAME_M and frozenset((int(nearest[a]), int(nearest[b]))) in there
        for a, b in network.edges.tolist()
    ]
    return Stability(float(np.mean(step_m < 0.03)), 1e3 * float(np.median(step_m)), float(np.mean(kept)))


def _mean(steps: list[Stability]) -> Stability:
    return Stability(
        float(np.mean([step.nodes_within_3_cm for step in steps])),
        float(np.mean([step.median_step_mm for step in steps])),
        float(np.mean([step.connections_kept for step in steps])),
    )
