"""`calibrate camera`: how the depth camera sits, by the floor it sees, and by a wall that the scanner sees too."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_app.calibrate.change import Change
from robot_app.calibrate.estimate import Estimate, line
from robot_app.calibrate.guide import CalibrationError, Guide
from robot_app.calibrate.sampling import collect
from robot_app.config import AnyRobotConfig
from robot_app.drivers.base import DepthCamera, DepthImage, RawScan, Scanner
from shared.geometry.camera import CameraMount
from shared.runtime.clock import Clock

_FRAMES, _SCANS, _EVERY_S = 20, 40, 0.02
_STRIDE = 4  # pixels
_FLOOR_BANDS = (0.10, 0.05, 0.03, 0.02, 0.02)  # of height about the plane so far: m, and m more for each metre ahead
_FLOOR_REACH_M = 2.5
_MOST_TILT_RAD = 0.35
_FLOOR_FEWEST = 800
_FLOOR_LEAST_DEPTH_M, _FLOOR_LEAST_WIDTH_M = 0.4, 0.3  # how far the floor points must reach for its tilt to be known
_FLAT_SHARE = 0.7  # of what is near the plane at first sight must be on it at last
_PARTS, _PART_M = 8, 0.05
_FLOOR_RAD, _FLOOR_M = math.radians(0.1), 0.002  # how level a room's floor is, and how true the camera's distances
_LEAST_NEAR_M = 0.5  # the L515 sees nothing nearer
_WALL_BANDS_M = (0.15, 0.06, 0.03)
_WALL_LEAST_HEIGHT_M, _WALL_LOOKS_RAD = 0.08, math.radians(20)
_WALL_FEWEST = 300
_MOST_YAW_RAD = math.radians(15)
_SCANNER_WRONG_M = 0.03  # its distances are off by up to so much, in a wave

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FloorView:
    """Of the camera over the floor; `roll_rad`: its right side down."""

    pitch_down: Estimate
    roll: Estimate
    height: Estimate
    flatness_m: float


def calibrate_camera(
    camera: DepthCamera, scanner: Scanner, config: AnyRobotConfig, guide: Guide, clock: Clock
) -> list[Change]:
    """Raises `CalibrationError` when floor or wall are not to be seen."""
    mount = config.camera
    guide.until_enter("Put the robot on level floor, with 2 m of empty floor ahead of it", lambda: None)
    frames = [_points(image, camera) for image in _frames(camera, clock)]
    floor = find_floor(frames, mount)
    guide.say(
        f"The floor is seen flat to {floor.flatness_m * 1000:.0f} mm. "
        f"The camera looks {math.degrees(floor.pitch_down.value):+.2f}° down and leans "
        f"{math.degrees(floor.roll.value):+.2f}° to the right, {floor.height.value * 100:.1f} cm over the floor."
    )
    changes = [
        _angle("camera.pitch_down_rad", mount.pitch_down_rad, floor.pitch_down),
        _angle("camera.roll_right_rad", mount.roll_right_rad, floor.roll),
        Change("camera.z_m", mount.z_m, floor.height.value, f"± {floor.height.sigma * 1000:.1f} mm"),
    ]
    if not guide.agree("Is there a plain wall, 1 m wide or more, to compare it with the scanner?"):
        guide.say("Its direction stays as it is.")
        return changes
    guide.until_enter("Put the robot 0.8 to 1.5 m before the wall, facing it", lambda: None)
    level = CameraMount(0.0, floor.height.value, floor.pitch_down.value, floor.roll.value)
    seen = np.concatenate([_points(image, camera) for image in _frames(camera, clock)])
    scans = collect(clock, _SCANS, _EVERY_S, lambda: scanner.read(0.05), "scanner")
    yaw, ahead_m = find_wall(_moved(seen, level), _scan_points(scans, scanner))
    guide.say(f"By the scanner the camera is {ahead_m:.3f} m ahead of the rear axle; robot.toml says {mount.x_m:.3f}.")
    if abs(ahead_m - mount.x_m) > _SCANNER_WRONG_M:
        guide.say("That is more than the scanner is wrong: measure camera.x_m with a ruler.")
    return [*changes, _angle("camera.yaw_left_rad", mount.yaw_left_rad, yaw)]


def find_floor(frames: list[Vector], mount: CameraMount) -> FloorView:
    """The floor plane in `frames`, each (N, 3) in the optical frame, near where `mount` expects it."""
    matrix = mount.robot_from_optical()
    up, height_m = matrix[2, :3], float(matrix[2, 3])
    every = np.concatenate(frames)
    every = every[every[:, 2] < _FLOOR_REACH_M]
    sizes = []
    for band in _FLOOR_BANDS:
        near = every[np.abs(every @ up + height_m) < band * (1 + every[:, 2])]
        if len(near) < _FLOOR_FEWEST:
            raise CalibrationError(
                "the camera does not see the floor where camera.z_m and camera.pitch_down_rad expect it; correct them "
                "by hand first, and clear the floor"
            )
        sizes.append(len(near))
        up, height_m = _plane(near, up)
    _check_floor(near, up)
    if sizes[-1] < _FLAT_SHARE * sizes[1]:
        raise CalibrationError("the floor is not flat or not empty, or the camera does not see it well")
    tilts = np.array([_tilt(*_plane(part, up)) for part in _parts(near)])
    pitch, roll, height = _tilt(up, height_m)
    sigma = tilts.std(axis=0, ddof=1) / math.sqrt(len(tilts))
    rest = near @ up + height_m
    return FloorView(
        Estimate(pitch, math.hypot(sigma[0], _FLOOR_RAD)),
        Estimate(roll, math.hypot(sigma[1], _FLOOR_RAD)),
        Estimate(height, math.hypot(sigma[2], _FLOOR_M)),
        1.4826 * float(np.median(np.abs(rest))),
    )


def find_wall(camera_m: Vector, scanner_m: Vector) -> tuple[Estimate, float]:
    """How far the camera is turned to the left, and how far it is ahead of the robot's origin.

    `camera_m` (N, 3): level, origin on the floor below the camera. `scanner_m` (M, 2): robot frame. Of one wall.
    """
    seen = camera_m[camera_m[:, 2] > _WALL_LEAST_HEIGHT_M][:, :2]
    lines = []
    for points, who in ((seen, "camera"), (scanner_m, "scanner")):
        ahead = points[np.abs(np.arctan2(points[:, 1], points[:, 0])) < _WALL_LOOKS_RAD]
        lines.append(_wall(ahead, who))
    (seen_rad, seen_m, seen_sigma), (scanned_rad, scanned_m, scanned_sigma) = lines
    yaw = Estimate(scanned_rad - seen_rad, math.hypot(seen_sigma, scanned_sigma))
    if abs(yaw.value) > _MOST_YAW_RAD:
        raise CalibrationError(
            f"camera and scanner disagree by {math.degrees(yaw.value):.0f}°: do both see the same wall, and only it?"
        )
    return yaw, (scanned_m - seen_m) / math.cos(scanned_rad)


def _wall(points_m: Vector, who: str) -> tuple[float, float, float]:
    """Direction and distance of the wall's normal, and the deviation of the direction; of (N, 2)."""
    if len(points_m) < 30:
        raise CalibrationError(f"the {who} sees no wall ahead")
    at_m, slope = float(np.median(points_m[:, 0])), 0.0
    for band_m in _WALL_BANDS_M:
        near = points_m[np.abs(points_m[:, 0] - at_m - slope * points_m[:, 1]) < band_m]
        if len(near) < min(_WALL_FEWEST, 0.4 * len(points_m)):
            raise CalibrationError(f"what the {who} sees ahead is no plain wall")
        (at_m, slope), covariance = line(near[:, 1], near[:, 0])
    angle_rad = -math.atan(slope)
    sigma = math.sqrt(covariance[1, 1]) * math.sqrt(_FRAMES)  # pixels of one place are wrong alike in all frames
    return angle_rad, at_m * math.cos(angle_rad), sigma


def _plane(points: Vector, up: Vector) -> tuple[Vector, float]:
    """Normal, on the side of `up`, and height of the origin over the plane; least squares of (N, 3)."""
    centre = points.mean(axis=0)
    normal = np.linalg.svd(np.cov((points - centre).T))[2][2]
    normal = normal if normal @ up > 0 else -normal
    return normal, float(-normal @ centre)


def _tilt(up: Vector, height_m: float) -> tuple[float, float, float]:
    """Pitch down, roll to the right and height, of `up` in the optical frame (x right, y down, z forward)."""
    return math.asin(-up[2]), math.atan2(-up[0], -up[1]), height_m


def _check_floor(near: Vector, up: Vector) -> None:
    pitch, roll, _ = _tilt(up, 0.0)
    if abs(roll) > _MOST_TILT_RAD or abs(pitch) > 2 * _MOST_TILT_RAD:
        raise CalibrationError("what the camera takes for the floor is none; clear the floor and try again")
    depth_m, width_m = np.ptp(near[:, 2]), np.ptp(near[:, 0])
    if depth_m < _FLOOR_LEAST_DEPTH_M or width_m < _FLOOR_LEAST_WIDTH_M:
        raise CalibrationError(f"only {depth_m:.1f} x {width_m:.1f} m of floor are seen; clear 2 m ahead of the robot")


def _frames(camera: DepthCamera, clock: Clock) -> list[DepthImage]:
    return collect(clock, _FRAMES, _EVERY_S, lambda: camera.read(0.1), "depth camera")


def _parts(floor: Vector) -> list[Vector]:
    """Eight parts by place, each as wide and as deep as the whole: noise of one place is the same in all frames."""
    cells = np.floor(floor[:, [0, 2]] / _PART_M).astype(np.int64)
    part = (cells[:, 0] * 3 + cells[:, 1] * 5) % _PARTS
    return [floor[part == i] for i in range(_PARTS)]


def _points(image: DepthImage, camera: DepthCamera) -> Vector:
    """(N, 3), optical frame, of every fourth pixel."""
    columns, rows = camera.intrinsics.ray_slopes()
    depth_m = image.depth[::_STRIDE, ::_STRIDE] * image.unit_m
    grid = np.stack(
        [columns[None, ::_STRIDE] * depth_m, rows[::_STRIDE, None] * depth_m, depth_m], axis=-1, dtype=np.float64
    )
    points: Vector = grid[depth_m > _LEAST_NEAR_M]
    return points


def _moved(optical_m: Vector, mount: CameraMount) -> Vector:
    matrix = mount.robot_from_optical()
    moved: Vector = optical_m @ matrix[:3, :3].T + matrix[:3, 3]
    return moved


def _scan_points(scans: list[RawScan], scanner: Scanner) -> Vector:
    """(N, 2), robot frame; the median of each beam."""
    ranges = np.array([scan.ranges_m for scan in scans], np.float64)
    good = np.isfinite(ranges).mean(axis=0) > 0.5
    typical_m = np.nanmedian(ranges[:, good], axis=0)
    angles = scanner.geometry.angles_rad(ranges.shape[1])[good]
    return scanner.geometry.robot_from_scanner.apply(
        np.column_stack([typical_m * np.cos(angles), typical_m * np.sin(angles)])
    )


def _angle(key: str, before: float, after: Estimate) -> Change:
    return Change(key, before, after.value, f"± {math.degrees(after.sigma):.2f}°")
