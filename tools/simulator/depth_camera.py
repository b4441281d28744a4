"""The depth camera: remembers the newest frame's moment and renders it when somebody reads it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robot_app.drivers.base import DepthImage
from shared.geometry.camera import CameraMount, Intrinsics
from tools.simulator._kernels import inverse_depth, noisy_depth
from tools.simulator.egl import EglContext
from tools.simulator.engine import mujoco
from tools.simulator.mailbox import Mailbox
from tools.simulator.mjcf import CAMERA_FAR_M, ROBOT_GROUP
from tools.simulator.scenario import CameraParameters, Scenario
from tools.simulator.world import World

_FONT_SCALE = 100
_OFF_SCREEN = 1
_MAX_GEOMS = 2000


@dataclass(frozen=True, slots=True, eq=False)
class Exposure:
    """The moment of a frame and all that its image depends on."""

    index: int
    stamp_s: float
    state: NDArray[np.float64]


class ExposureClock:
    """Marks the moments of the frames while the world moves."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._period_s = 1 / world.scenario.camera.rate_hz
        self._began_s = world.elapsed_s + float(world.random("camera").uniform(0, self._period_s))
        self._index = 0
        self.exposures: Mailbox[Exposure] = Mailbox(world.moved)

    def after_step(self) -> None:
        if self._world.elapsed_s < self._began_s + self._index * self._period_s:
            return
        self.exposures.put(Exposure(self._index, self._world.time_s, self._world.camera_state()))
        self._index += 1


def camera_intrinsics(parameters: CameraParameters) -> Intrinsics:
    return Intrinsics.from_field_of_view(
        parameters.width,
        parameters.height,
        math.radians(parameters.horizontal_deg),
        math.radians(parameters.vertical_deg),
    )


def camera_mount(scenario: Scenario) -> CameraMount:
    body = scenario.body
    return CameraMount(body.camera_x_m, body.camera_z_m, math.radians(body.camera_pitch_down_deg))


class DepthRenderer:
    """Depth images of a model; an OpenGL context is bound to a thread, so make, use and close it in the same one.

    A copy of the physics' data is drawn, so the world may step meanwhile.
    """

    def __init__(self, model: Any, parameters: CameraParameters) -> None:
        self._model = model
        self._data = mujoco.MjData(model)
        self._rect = mujoco.MjrRect(0, 0, parameters.width, parameters.height)
        self._buffer = np.empty((parameters.height, parameters.width), np.float32)
        self._option = mujoco.MjvOption()
        self._option.geomgroup[ROBOT_GROUP] = 0
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._camera.fixedcamid = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, "depth")
        self._scene = mujoco.MjvScene(model, _MAX_GEOMS)
        self._gl: EglContext | None = EglContext()
        with self._gl.current():
            self._context = mujoco.MjrContext(model, _FONT_SCALE)
            mujoco.mjr_setBuffer(_OFF_SCREEN, self._context)
            self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR

    def render(self, state: NDArray[np.float64], inverse_per_m: NDArray[np.float32]) -> None:
        """Fill `inverse_per_m` (H, W): one over the true distance along the optical axis, 0 where there is nothing."""
        assert self._gl is not None, "closed"
        self._data.qpos[:] = state
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        category = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self._model, self._data, self._option, None, self._camera, category, self._scene)
        # Flat colours, no lighting: only the depth is wanted. `mjv_updateScene` leaves the flags alone.
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = 1
        self._scene.flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 1
        with self._gl.current():
            mujoco.mjr_render(self._rect, self._scene, self._context)
            mujoco.mjr_readPixels(None, self._buffer, self._rect, self._context)
        near_m = self._model.vis.map.znear * self._model.stat.extent
        inverse_depth(self._buffer, near_m, CAMERA_FAR_M, inverse_per_m)

    def close(self) -> None:
        if self._gl is not None:
            with self._gl.current():
                self._context.free()
            self._gl.close()
            self._gl = None


class DepthSensor:
    """The noise between a true depth image and what the camera reports."""

    def __init__(self, parameters: CameraParameters, seed: int) -> None:
        self._p = parameters
        self._seed = seed
        self.intrinsics = camera_intrinsics(parameters)
        self._columns, self._rows = self.intrinsics.ray_slopes()
        self._above = np.empty(parameters.width, np.float32)
        self._sigma_slope = (parameters.sigma_at_9m_m - parameters.sigma_at_1m_m) / 8

    def image(self, inverse_per_m: NDArray[np.float32], index: int, stamp_s: float) -> DepthImage:
        """Frame `index` always has the same noise, whoever read the frames before it."""
        p = self._p
        out = np.empty(inverse_per_m.shape, np.uint16)
        key = np.random.SeedSequence([self._seed, index]).generate_state(1, np.uint64)[0]
        noisy_depth(
            inverse_per_m, self._columns, self._rows, key, p.unit_m, p.range_min_m, p.range_max_m,
            p.sigma_at_1m_m, self._sigma_slope, p.neighbour_correlation, p.dropout,
            p.edge_fraction, p.edge_lost, p.edge_flying, 2 * p.min_signal_per_m2 / p.reflectivity, self._above, out,
        )  # fmt: skip
        out.setflags(write=False)
        return DepthImage(stamp_s, out, p.unit_m)
