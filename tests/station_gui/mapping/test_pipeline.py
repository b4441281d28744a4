"""From observations to the map, through the pipeline that the station builds."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.geometry.rays import cast_rays
from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork, Observation, ScanGeometry
from station_gui.build import build_pipeline
from station_gui.config import load_config
from station_gui.mapping.pipeline import MappingPipeline
from station_gui.mapping.saved_map import SavedMap
from station_gui.mapping.slam2d.base import MappingError
from station_gui.mapping.snapshot import Tracking

_ROOM = np.array(  # x0, y0, x1, y1 of its walls
    [
        *((-4, -3, 4, -3), (4, -3, 4, 1), (4, 1, 1, 1), (1, 1, 1, 3), (1, 3, -4, 3), (-4, 3, -4, -3)),
        *((-2, -1, -1.5, -1), (-1.5, -1, -1.5, -0.5), (-1.5, -0.5, -2, -0.5), (-2, -0.5, -2, -1), (2, -2, 2.6, -2)),
    ],
    np.float64,
)
_GEOMETRY = ScanGeometry(-math.pi / 2, math.pi / 180, 0.0, 0.05, 50.0, Pose2())
_WAY = [Pose2(-3 + 0.06 * k, -2.2 + 0.2 * math.sin(0.1 * k), 0.02 * k) for k in range(60)]


def _observation(sequence: int, pose: Pose2, boot_id: int = 1, odom: Pose2 | None = None) -> Observation:
    """A perfect scan of the room."""
    angles = _GEOMETRY.angles_rad(181) + pose.theta_rad
    ranges = np.empty(len(angles))
    cast_rays(pose.x_m, pose.y_m, angles, _ROOM, 50.0, ranges)
    return Observation(
        sequence, 0.1 * sequence, odom or pose, 0.0, 0.0, _GEOMETRY, ranges.astype(np.float32), ObjectNetwork(),
        has_objects=False, boot_id=boot_id,
    )  # fmt: skip


def _blind(observation: Observation, beams: int = 0) -> Observation:
    """As `observation`, of which only a few beams have come back."""
    ranges: NDArray[np.float32] = np.full_like(observation.ranges_m, np.nan)
    ranges[:beams] = 1.0
    return replace(observation, ranges_m=ranges)


def _pipeline(method: str = "graph") -> MappingPipeline:
    return build_pipeline(replace(load_config(None), method=method))


@pytest.fixture
def driven() -> MappingPipeline:
    """With the map of one way through the room."""
    pipeline = _pipeline()
    for k, pose in enumerate(_WAY):
        pipeline.add(_observation(k, pose))
    return pipeline


@pytest.mark.parametrize("method", ["graph", "particle"])
@pytest.mark.parametrize("beams", [0, 8])
def test_a_robot_that_saw_nothing_at_first_is_not_lost(method: str, beams: int) -> None:
    pipeline = _pipeline(method)
    for k in range(4):
        pipeline.add(_blind(_observation(k, _WAY[0]), beams))
        assert pipeline.tracking is Tracking.LOCATED
    for k in range(4, 40):
        pipeline.add(_observation(k, _WAY[0]))
        assert pipeline.tracking is Tracking.LOCATED
    pipeline.finish()
    snapshot = pipeline.snapshot()
    assert int((snapshot.grid.probability < 0.5).sum()) > 1000
    assert snapshot.map_from_robot.distance_m(_WAY[0]) < 0.02


@pytest.mark.parametrize("boots", [(7,), (7, 7), (7, 8, 9), (7, 8, 7, 8)])
def test_strays_of_another_start_leave_the_map_alone(driven: MappingPipeline, boots: tuple[int, ...]) -> None:
    begun = driven.maps_begun
    for k, boot_id in enumerate(boots):
        assert not driven.add(_observation(k, _WAY[0], boot_id))
    assert driven.add(_observation(60, _WAY[-1]))
    assert not driven.add(_observation(2, _WAY[0], 7))
    assert driven.maps_begun == begun
    assert driven.observations == 61


def test_one_observation_sent_three_times_is_no_new_start(driven: MappingPipeline) -> None:
    begun = driven.maps_begun
    for _ in range(5):
        driven.add(_observation(3, _WAY[0], 7))
    assert driven.maps_begun == begun


def test_a_robot_that_was_restarted_is_found_in_the_map_that_there_is(driven: MappingPipeline) -> None:
    before = driven.snapshot()
    start = _WAY[30]
    for k in range(40):
        pose = _WAY[min(30 + k, 50)]
        driven.add(_observation(k, pose, 7, odom=start.inverse() @ pose))
    after = driven.snapshot()

    assert after.observations == 40
    assert after.tracking is Tracking.LOCATED
    assert after.map_from_robot.distance_m(_WAY[50]) < 0.03
    assert len(after.trajectory) >= len(before.trajectory)


def test_of_a_restart_before_there_was_a_map_nothing_is_kept() -> None:
    pipeline = _pipeline()
    pipeline.add(_observation(0, _WAY[0]))
    for k in range(3):
        pipeline.add(_observation(k, _WAY[10], 7, odom=Pose2()))
    assert pipeline.tracking is Tracking.LOCATED
    assert pipeline.snapshot().observations == 3
    assert pipeline.map_from_robot.distance_m(Pose2()) < 0.02


def test_stamps_of_later_sessions_follow_those_before(driven: MappingPipeline) -> None:
    for boot_id in (7, 8):
        for k, pose in enumerate(_WAY):
            driven.add(_observation(k, pose, boot_id))
        assert driven.tracking is Tracking.LOCATED
    snapshot = driven.snapshot()
    stamps = snapshot.trajectory[:, 0]
    assert (np.diff(stamps) > 0).all()
    assert stamps[-1] > 12.0
    assert snapshot.stamp_s == pytest.approx(5.9)


def _forged(saved: SavedMap, name: str) -> SavedMap:
    match name:
        case "far node":
            return replace(saved, nodes=np.vstack((saved.nodes[:-1], [[9e4, 9e4, 0.0]])))
        case "far scan":
            away = np.array([2e3, 0.0, 0.0])
            return replace(saved, keyframes=(*saved.keyframes[:-1], replace(saved.keyframes[-1], in_node=away)))
    away = np.full(2, 9e4)
    return replace(saved, keyframes=tuple(replace(keyframe, scanner_m=away) for keyframe in saved.keyframes))


@pytest.mark.parametrize("fixed", [False, True])
@pytest.mark.parametrize("name", ["far node", "far scan", "far scanner"])
def test_a_map_that_cannot_be_drawn_is_refused_and_the_present_one_stays(
    driven: MappingPipeline, name: str, fixed: bool
) -> None:
    before = driven.snapshot()
    with pytest.raises(MappingError):
        driven.open_map(_forged(driven.saved_map(), name), fixed=fixed)

    assert driven.add(_observation(60, _WAY[-1]))
    after = driven.snapshot()
    assert not after.fixed
    assert after.tracking is Tracking.LOCATED
    assert len(after.trajectory) >= len(before.trajectory)
