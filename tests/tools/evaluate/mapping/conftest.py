from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from station_gui.mapping.snapshot import ObjectMap
from tools.evaluate.mapping.edges import SeenThings, seen_things
from tools.evaluate.mapping.world import TrueWorld, camera_places, true_world
from tools.simulator.scenario import Item, Room, Scenario, Start

FloatArray = NDArray[np.float64]
Outline = Callable[..., FloatArray]
MakeMap = Callable[..., ObjectMap]


def way_round(radius_m: float) -> FloatArray:
    """(N, 4): a circle round (3, 3) that is driven looking at its middle."""
    angle = np.linspace(0, math.tau, 120)
    return np.column_stack((angle, 3 + radius_m * np.cos(angle), 3 + radius_m * np.sin(angle), angle + math.pi))


@pytest.fixture(scope="session")
def scenario() -> Scenario:
    """A room of 6 m with a box in its middle, one beside it and a table."""
    items = (
        Item("box", (3.0, 3.0), (0.4, 0.6, 0.5)),
        Item("small", (4.0, 4.0), (0.3, 0.3, 0.3), yaw_deg=30.0),
        Item("table", (2.0, 2.2), (0.8, 0.6, 0.7), "table"),
    )
    return Scenario("test", Start((1.0, 1.0)), Room(6.0, 6.0, 1.5), items)


@pytest.fixture(scope="session")
def world(scenario: Scenario) -> TrueWorld:
    return true_world(scenario)


@pytest.fixture(scope="session")
def things(world: TrueWorld, scenario: Scenario) -> SeenThings:
    return seen_things(world, camera_places(scenario, way_round(2.4)))


@pytest.fixture(scope="session")
def outline() -> Outline:
    """(12, 2, 3): the edges of an upright box, its four upright ones first; pulled by `shift_m` in x."""

    def make(
        center_m: tuple[float, float], size_m: tuple[float, float, float], yaw_deg: float = 0.0, shift_m: float = 0.0
    ) -> FloatArray:
        c, s = math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))
        flat = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * np.array(size_m[:2]) / 2 @ np.array([[c, s], [-s, c]])
        flat = flat + np.array(center_m) + (shift_m, 0.0)
        low, high = (np.column_stack((flat, np.full(4, z))) for z in (0.0, size_m[2]))
        ring = np.roll(np.arange(4), -1)
        return np.concatenate(
            [np.stack((low, high), 1), np.stack((low, low[ring]), 1), np.stack((high, high[ring]), 1)]
        )

    return make


@pytest.fixture(scope="session")
def map_of() -> MakeMap:
    """A map with an object for each of the given (S, 2, 3) arrays."""

    def make(*pieces_m: FloatArray) -> ObjectMap:
        segments_m = np.concatenate([np.zeros((0, 2, 3)), *pieces_m]).astype(np.float32)
        cluster = np.repeat(np.arange(len(pieces_m)), [len(piece) for piece in pieces_m]).astype(np.int32)
        return ObjectMap(segments_m, np.zeros(len(segments_m), np.uint8), cluster)

    return make
