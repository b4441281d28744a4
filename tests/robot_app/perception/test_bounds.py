"""Frames made to be as dear as can be: the work is counted, not timed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from robot_app.drivers.base import DepthImage
from robot_app.perception.config import EdgeConfig, LearningConfig, PerceptionConfig
from robot_app.perception.object_extractor import ObjectExtractor

UNIT_M = 0.00025
ROW, COLUMN = np.mgrid[:480, :640]
SMALL = PerceptionConfig(EdgeConfig(max_edges=800, max_samples=300), LearningConfig(max_nodes=40))


def noise() -> np.ndarray:
    return np.random.default_rng(0).integers(2000, 36000, (480, 640))


def blocks() -> np.ndarray:
    return np.kron(np.random.default_rng(0).integers(2000, 36000, (30, 40)), np.ones((16, 16), int))


FRAMES = {
    "noise": noise,
    "blocks of noise": blocks,
    "fine chequers": lambda: np.where((ROW // 16 + COLUMN // 16) % 2, 4000, 9000),
    "coarse chequers": lambda: np.where((ROW // 32 + COLUMN // 32) % 2, 4000, 9000),
    "chequers of three cells": lambda: np.where((ROW // 12 + COLUMN // 12) % 2, 4000, 9000),
    "stripes": lambda: np.where(COLUMN // 8 % 2, 4000, 9000),
    "holes": lambda: np.where(np.random.default_rng(1).random((480, 640)) < 0.5, 0, 8000),
    "tents": lambda: 4000 + 200 * np.abs(COLUMN % 80 - 40),
    "nothing": lambda: np.zeros((480, 640), int),
    "a wall": lambda: np.full((480, 640), 4000),
}


def work_of(world, config: PerceptionConfig, depth: np.ndarray) -> tuple[int, int, int]:
    """Edges, samples, and the most nodes that learning has had room for."""
    extractor = ObjectExtractor(config, world.intrinsics, world.mount)
    extractor.find_edges(DepthImage(0.0, depth.astype(np.uint16), UNIT_M))
    extractor.learn()
    learned = extractor.network.nodes
    extractor.refine()
    objects = extractor.objects()
    assert len(objects.nodes_m) <= learned
    assert np.all(np.isfinite(objects.nodes_m))
    return extractor.cloud.edges, extractor.cloud.samples, learned


@pytest.mark.parametrize("name", FRAMES)
def test_no_frame_costs_more_than_the_caps_allow(world, name: str) -> None:
    depth = FRAMES[name]()
    for config in (PerceptionConfig(), SMALL):
        edges, samples, nodes = work_of(world, config, depth)
        assert edges <= config.edges.max_edges
        assert samples <= config.edges.max_samples
        assert nodes <= config.learning.max_nodes


def test_the_caps_are_met_by_frames_that_are_all_edges(world) -> None:
    edges, samples, nodes = work_of(world, SMALL, FRAMES["stripes"]())
    assert edges == SMALL.edges.max_edges
    edges, samples, nodes = work_of(world, SMALL, FRAMES["coarse chequers"]())
    assert samples > 0.8 * SMALL.edges.max_samples
    assert nodes > 0.5 * SMALL.learning.max_nodes


def test_an_ordinary_frame_is_far_from_the_caps(world, room_image) -> None:
    edges, samples, nodes = work_of(world, PerceptionConfig(), room_image.depth)
    assert 2 * edges < EdgeConfig().max_edges
    assert 2 * samples < EdgeConfig().max_samples
    assert nodes < LearningConfig().max_nodes


def test_what_no_cap_can_be_is_refused() -> None:
    with pytest.raises(ValueError, match="max_detail"):
        replace(EdgeConfig(), range_max_m=20.0)
    with pytest.raises(ValueError, match="max_edges"):
        replace(EdgeConfig(), max_edges=1)
