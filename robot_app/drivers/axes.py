"""From a chip's axes to the robot's."""

from __future__ import annotations

from dataclasses import dataclass

from robot_app.drivers.config import Axis


@dataclass(frozen=True, slots=True)
class AxisOf:
    index: int
    sign: float


AxisMap = tuple[AxisOf, AxisOf, AxisOf]


def axis_map(names: tuple[Axis, Axis, Axis]) -> AxisMap:
    x, y, z = (AxisOf("xyz".index(name[-1]), -1.0 if name.startswith("-") else 1.0) for name in names)
    return x, y, z


def mapped(digits: tuple[int, ...], axes: AxisMap, scale: float) -> tuple[float, float, float]:
    """Three values of the chip's axes, scaled, along the robot's."""
    x, y, z = (axis.sign * scale * digits[axis.index] for axis in axes)
    return x, y, z
