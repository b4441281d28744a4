"""The MuJoCo model of a scenario and its car.

The robot's geoms are in group 3, so that rays and the camera leave them out, and touch the world but not one
another: `contype 0, conaffinity 1` against the world's `1/1`. Ellipsoid wheels roll without the chatter of
cylinders. The rear wheels share one velocity actuator through a tendon, which is an open differential.
"""

from __future__ import annotations

import math

from shared.geometry.omni3 import WHEEL_ANGLES_RAD
from tools.simulator.scenario import CameraParameters, CarParameters, OmniParameters, Scenario
from tools.simulator.solids import Solid, solids_of

STEP_S = 0.002
ROBOT_GROUP = 3
CAMERA_FAR_M = 12.0
_SLOT_BOTTOM_M, _SLOT_TOP_M = 0.082, 0.105  # the scanner looks out between the two decks
TRACTION_NS_PER_M = 600.0  # how stiffly an omnidirectional wheel follows the floor
_GRAVITY_MPS2 = 9.81
_WHEEL_KG = 0.1
_KNUCKLE_KG = 0.02
_KNUCKLE_RANGE_RAD = 0.68
_ROBOT = f'contype="0" conaffinity="1" group="{ROBOT_GROUP}"'


def mjcf(scenario: Scenario) -> str:
    """The XML text of the model."""
    camera = scenario.camera
    extent, is_car = 5.0, scenario.robot == "car"
    solids = "\n".join(_solid(solid) for solid in solids_of(scenario))
    return f"""<mujoco model="{scenario.name}">
<compiler angle="radian" autolimits="true"/>
<option timestep="{STEP_S}" integrator="implicitfast" solver="Newton" cone="elliptic" impratio="10"/>
<statistic extent="{extent}" center="2 2 0.3"/>
<visual><global offwidth="{camera.width}" offheight="{camera.height}"/>
<map znear="{0.02 / extent}" zfar="{CAMERA_FAR_M / extent}"/><quality shadowsize="0" offsamples="0"/></visual>
<worldbody>
<geom name="floor" type="plane" size="0 0 0.1"/>
{solids}
{_car(scenario.car, camera, scenario.floor_friction) if is_car else _omni(scenario.omni, camera)}
</worldbody>
{_car_actuators(scenario.car) if is_car else _omni_actuators(scenario.omni, scenario.floor_friction)}
<sensor><accelerometer name="accelerometer" site="imu"/><gyro name="gyro" site="imu"/></sensor>
</mujoco>"""


def _car_actuators(car: CarParameters) -> str:
    return f"""<tendon>
<fixed name="drive"><joint joint="rl_spin" coef="0.5"/><joint joint="rr_spin" coef="0.5"/></fixed>
</tendon>
<actuator>
<position name="fl_servo" joint="fl_steer" kp="6" kv="0.2"/>
<position name="fr_servo" joint="fr_steer" kp="6" kv="0.2"/>
<velocity name="motor" tendon="drive" kv="{motor_damping(car)}"/>
</actuator>"""


def motor_damping(car: CarParameters) -> float:
    """N m per rad/s: the slope of a DC motor from its stall torque to its no-load speed."""
    return car.stall_torque_nm / (car.no_load_speed_mps / car.wheel_radius_m)


def _solid(solid: Solid) -> str:
    x, y, z = solid.center_m
    hx, hy, hz = solid.half_m
    return (
        f'<geom name="{solid.name}" type="box" pos="{x:.9f} {y:.9f} {z:.9f}" euler="0 0 {solid.yaw_rad:.12f}" '
        f'size="{hx:.9f} {hy:.9f} {hz:.9f}"/>'
    )


def _car(car: CarParameters, camera: CameraParameters, friction: float) -> str:
    middle = (car.front_m - car.rear_m) / 2
    half_length, half_width = (car.front_m + car.rear_m) / 2, car.width_m / 2
    r = car.wheel_radius_m
    masses = {"deck_low": 0.55, "deck_high": 0.20, "bumper_front": 0.02, "bumper_rear": 0.02}
    body_kg = car.mass_kg - 4 * _WHEEL_KG - 2 * _KNUCKLE_KG
    kg = {name: share / sum(masses.values()) * body_kg for name, share in masses.items()}
    inner_half = half_width - car.wheel_width_m - 0.005
    boxes = [
        _box("deck_low", middle, half_length - 0.005, inner_half, 0.02, _SLOT_BOTTOM_M, r, kg["deck_low"]),
        _box("deck_high", middle, half_length, half_width, _SLOT_TOP_M, car.height_m, r, kg["deck_high"]),
        _box("bumper_front", car.front_m - 0.0025, 0.0025, half_width, 0.03, _SLOT_BOTTOM_M, r, kg["bumper_front"]),
        _box("bumper_rear", -car.rear_m + 0.0025, 0.0025, half_width, 0.03, _SLOT_BOTTOM_M, r, kg["bumper_rear"]),
    ]
    wheels = [
        _wheel("fl", car, car.wheelbase_m, 1, friction),
        _wheel("fr", car, car.wheelbase_m, -1, friction),
        _wheel("rl", car, 0.0, 1, friction),
        _wheel("rr", car, 0.0, -1, friction),
    ]
    newline = "\n"
    return f"""<body name="car" pos="0 0 {r}"><freejoint name="root"/>
{newline.join(boxes)}
<site name="imu" pos="{middle} 0 {0.05 - r}"/>
<site name="scanner" pos="{car.scanner_x_m} 0 {car.scanner_z_m - r}"/>
{_camera(car, camera)}
{newline.join(wheels)}
</body>"""


def _box(
    name: str, x_m: float, half_x_m: float, half_y_m: float, low_m: float, high_m: float, base_m: float, kg: float
) -> str:
    z, half_z = (low_m + high_m) / 2 - base_m, (high_m - low_m) / 2
    return (
        f'<geom name="{name}" type="box" pos="{x_m} 0 {z}" size="{half_x_m} {half_y_m} {half_z}" mass="{kg}" {_ROBOT}/>'
    )


def _camera(car: CarParameters | OmniParameters, camera: CameraParameters) -> str:
    """A pinhole camera with its own focal length along each axis."""
    pitch = math.radians(car.camera_pitch_down_deg)
    fx = camera.width / 2 / math.tan(math.radians(camera.horizontal_deg) / 2)
    fy = camera.height / 2 / math.tan(math.radians(camera.vertical_deg) / 2)
    return (
        f'<camera name="depth" pos="{car.camera_x_m} 0 {car.camera_z_m - car.wheel_radius_m}" '
        f'xyaxes="0 -1 0 {math.sin(pitch)} 0 {math.cos(pitch)}" resolution="{camera.width} {camera.height}" '
        f'sensorsize="{camera.width * 1e-5} {camera.height * 1e-5}" focalpixel="{fx:.9f} {fy:.9f}"/>'
    )


def grip_n(omni: OmniParameters, friction: float) -> float:
    """How hard each wheel can pull before it slips: a third of the weight is on it."""
    return friction * omni.mass_kg * _GRAVITY_MPS2 / 3


def _omni(omni: OmniParameters, camera: CameraParameters) -> str:
    """A disc on frictionless feet, which the wheels pull at where they touch the floor."""
    r = omni.wheel_radius_m
    feet_kg = 3 * _WHEEL_KG
    low_kg, high_kg = 0.75 * (omni.mass_kg - feet_kg), 0.25 * (omni.mass_kg - feet_kg)
    decks = [
        _disc("deck_low", omni.radius_m, 0.02, _SLOT_BOTTOM_M, r, low_kg),
        _disc("deck_high", omni.radius_m, _SLOT_TOP_M, omni.height_m, r, high_kg),
    ]
    feet = [_foot(i, angle, omni) for i, angle in enumerate(WHEEL_ANGLES_RAD)]
    newline = "\n"
    return f"""<body name="omni" pos="0 0 {r}"><freejoint name="root"/>
{newline.join(decks)}
<site name="imu" pos="0 0 {0.05 - r}"/>
<site name="scanner" pos="{omni.scanner_x_m} 0 {omni.scanner_z_m - r}"/>
{_camera(omni, camera)}
{newline.join(feet)}
</body>"""


def _disc(name: str, radius_m: float, low_m: float, high_m: float, base_m: float, kg: float) -> str:
    z, half_z = (low_m + high_m) / 2 - base_m, (high_m - low_m) / 2
    return f'<geom name="{name}" type="cylinder" pos="0 0 {z}" size="{radius_m} {half_z}" mass="{kg}" {_ROBOT}/>'


def _foot(index: int, angle_rad: float, omni: OmniParameters) -> str:
    """A site whose x axis is the direction in which the wheel drives, and a foot above it."""
    x, y = omni.wheel_distance_m * math.cos(angle_rad), omni.wheel_distance_m * math.sin(angle_rad)
    r = omni.wheel_radius_m
    return (
        f'<geom name="wheel_{index}" type="sphere" size="{r}" pos="{x} {y} 0" mass="{_WHEEL_KG}" '
        f'friction="0 0 0" condim="1" priority="1" {_ROBOT}/>'
        f'<site name="wheel_{index}" pos="{x} {y} {-r}" euler="0 0 {angle_rad + math.pi / 2}"/>'
    )


def _omni_actuators(omni: OmniParameters, friction: float) -> str:
    limit = grip_n(omni, friction)
    motors = [
        f'<velocity name="motor_{i}" site="wheel_{i}" gear="1 0 0 0 0 0" kv="{TRACTION_NS_PER_M}" '
        f'forcerange="{-limit} {limit}"/>'
        for i in range(len(WHEEL_ANGLES_RAD))
    ]
    return f"<actuator>{''.join(motors)}</actuator>"


def _wheel(name: str, car: CarParameters, x_m: float, side: int, friction: float) -> str:
    r = car.wheel_radius_m
    joint = (
        f'<joint name="{name}_spin" type="hinge" axis="0 1 0" damping="0.0005" armature="0.0004" '
        f'frictionloss="{car.gear_friction_nm if x_m == 0 else 0.002}"/>'
    )
    geom = (
        f'<geom name="wheel_{name}" type="ellipsoid" size="{r} {r} {car.wheel_width_m / 2}" '
        f'euler="1.5707963267949 0 0" mass="{_WHEEL_KG}" '
        f'friction="{friction} 0.005 0.0001" condim="3" priority="1" {_ROBOT}/>'
    )
    place = f'pos="{x_m} {side * car.track_m / 2} 0"'
    if x_m == 0:
        return f'<body name="{name}" {place}>{joint}{geom}</body>'
    steer = (
        f'<joint name="{name}_steer" type="hinge" axis="0 0 1" range="-{_KNUCKLE_RANGE_RAD} {_KNUCKLE_RANGE_RAD}" '
        f'damping="0.02" armature="0.002"/>'
        f'<inertial pos="0 0 0" mass="{_KNUCKLE_KG}" diaginertia="1e-5 1e-5 1e-5"/>'
    )
    return f'<body name="{name}" {place}>{steer}<body name="{name}_hub">{joint}{geom}</body></body>'
