"""What is done to the robot, one fault after the other."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from robot_app import schedule
from robot_app.drivers.base import EncoderCount, ImuSample, PowerSample, RawScan, TemperatureSample
from shared.runtime.runner import Row
from tools.simulator.faults import Fault, FaultKind
from tools.simulator.lockstep import Lockstep

FOR_EVER = math.inf
_A_WHILE_S = 3.0
_WATCHED_S = 6.5
LIMIT_S = 0.3  # from the loss of something that the car needs until it stands
_SILENCE_LIMIT_S = 1.6  # until it stands because nobody speaks: a second, and what braking gently takes
_SLOW_LIMIT_S = 2.0  # the same of a battery and of heat: their sensors are slow, and so are they
_NEEDED = ("scanner", "imu", "encoders", "drive")
_NOT_NEEDED = ("camera", "power", "thermometer")
_READS = {
    schedule.ODOMETRY: "encoders",
    schedule.SCAN: "scanner",
    schedule.DEPTH: "camera",
    schedule.POWER: "power",
    schedule.TEMPERATURE: "thermometer",
}
_STOPPING = (schedule.ODOMETRY, schedule.SCAN, schedule.CONTROL, schedule.COMMANDS)


@dataclass(frozen=True, slots=True)
class Case:
    """`stops`: the robot loses what it needs, and must stand. `resumes`: it may go on by itself after `lasts_s`."""

    name: str
    text: str
    begin: Callable[[Lockstep], None]
    end: Callable[[Lockstep], None]
    stops: bool
    lasts_s: float = FOR_EVER
    resumes: bool = True
    watched_s: float = _WATCHED_S  # after the beginning
    within_s: float = LIMIT_S  # where it must stand
    seen_s: float = math.inf  # when the operator's view is written down, unless the fault or half the watch ends before


def cases(rng: np.random.Generator) -> list[Case]:
    """In the order of the table."""
    return [*_unplugged(), *_scanner(rng), *_encoders(), *_imu(), *_power_and_heat(), *_links(), *_tasks()]


def _fault_of(system: Lockstep, device: str) -> Fault:
    fault: Fault = getattr(system.faults, device)
    return fault


def _of_kind(device: str, kind: FaultKind) -> Callable[[Lockstep], None]:
    def begin(system: Lockstep) -> None:
        _fault_of(system, device).kind = kind

    return begin


def _changed(device: str, make: Callable[[], Callable[[Any], Any]]) -> Callable[[Lockstep], None]:
    def begin(system: Lockstep) -> None:
        _fault_of(system, device).change = make()

    return begin


def _healed(device: str) -> Callable[[Lockstep], None]:
    def end(system: Lockstep) -> None:
        fault = _fault_of(system, device)
        fault.kind, fault.change = FaultKind.NONE, None

    return end


def _bridge_unplugged(system: Lockstep) -> None:
    """No current from then on, not only from the next setting on."""
    system.faults.drive.kind = FaultKind.UNPLUGGED
    system.world.cut_motor()


def _unplugged() -> list[Case]:
    found = []
    for device in (*_NEEDED, *_NOT_NEEDED):
        for seconds, how in ((_A_WHILE_S, "for 3 s"), (FOR_EVER, "for ever")):
            begin = _bridge_unplugged if device == "drive" else _of_kind(device, FaultKind.UNPLUGGED)
            name = f"{device}-unplugged" + ("-3s" if seconds == _A_WHILE_S else "")
            text = f"{device} unplugged {how}"
            resumes = math.isfinite(seconds)
            found.append(Case(name, text, begin, _healed(device), device in _NEEDED, seconds, resumes))
    return found


def _scanner(rng: np.random.Generator) -> list[Case]:
    def garbage() -> Callable[[Any], Any]:
        def change(scan: RawScan) -> RawScan:
            return replace(scan, ranges_m=rng.uniform(0.06, 4.0, len(scan.ranges_m)).astype(np.float32))

        return change

    kinds = (
        ("scanner-silent", "garbage on the scanner's line: nothing passes its check sums", FaultKind.SILENT),
        ("scanner-frozen", "scanner hangs and repeats its last scan", FaultKind.FROZEN),
        ("scanner-covered", "scanner covered", FaultKind.BLIND),
    )
    whole = [
        Case(name, text, _of_kind("scanner", kind), _healed("scanner"), True, _A_WHILE_S) for name, text, kind in kinds
    ]
    text = "scanner sends ranges drawn by lot, with right check sums"
    drawn = Case("scanner-garbage", text, _changed("scanner", garbage), _healed("scanner"), True, _A_WHILE_S)
    silent = _of_kind("scanner", FaultKind.SILENT)
    brief = Case("scanner-late", "no scan for 0.5 s", silent, _healed("scanner"), True, 0.5)
    return [brief, *whole, drawn]


def _encoders() -> list[Case]:
    def stuck(*sides: str) -> Callable[[], Callable[[Any], Any]]:
        def make() -> Callable[[Any], Any]:
            held: dict[str, int] = {}

            def change(count: EncoderCount) -> EncoderCount:
                for side in sides:
                    held.setdefault(side, getattr(count, side))
                return EncoderCount(count.stamp_s, held.get("left", count.left), held.get("right", count.right))

            return change

        return make

    def case(name: str, text: str, *sides: str) -> Case:
        return Case(name, text, _changed("encoders", stuck(*sides)), _healed("encoders"), True, resumes=False)

    frozen = _of_kind("encoders", FaultKind.FROZEN)
    return [
        Case("wheels-held", "no tick of both wheels for 0.3 s", frozen, _healed("encoders"), True, 0.3),
        case("encoder-stuck", "one encoder stuck", "left"),
        case("encoders-stuck", "both encoders stuck", "left", "right"),
    ]


def _imu() -> list[Case]:
    def biased(step_radps: float) -> Callable[[], Callable[[Any], Any]]:
        def change(imu: ImuSample) -> ImuSample:
            x, y, z = imu.gyro_radps
            return replace(imu, gyro_radps=(x, y, z + step_radps))

        return lambda: change

    def on_its_side(imu: ImuSample) -> ImuSample:
        x, y, z = imu.acceleration_mps2
        return replace(imu, acceleration_mps2=(x, z, -y))

    def bias(name: str, degrees: float, stops: bool, seen_s: float = math.inf) -> Case:
        text = f"bias of the gyro jumps by {degrees:.0f} °/s"
        begin = _changed("imu", biased(math.radians(degrees)))
        return Case(name, text, begin, _healed("imu"), stops, watched_s=12.0, seen_s=seen_s)

    tilted = _changed("imu", lambda: on_its_side)
    return [
        Case("imu-frozen", "IMU hangs and repeats its last sample", _of_kind("imu", FaultKind.FROZEN), _healed("imu"),
             True, _A_WHILE_S),
        bias("imu-bias-3", 3.0, False),
        bias("imu-bias-15", 15.0, True, seen_s=1.0),
        bias("imu-bias-60", 60.0, True),
        Case("tilted", "robot on its side", tilted, _healed("imu"), True, resumes=False),
    ]  # fmt: skip


def _power_and_heat() -> list[Case]:
    def volts(battery_v: float) -> Callable[[], Callable[[Any], Any]]:
        def change(power: PowerSample) -> PowerSample:
            return replace(power, battery_v=battery_v)

        return lambda: change

    def degrees(cpu_c: float) -> Callable[[], Callable[[Any], Any]]:
        def change(temperature: TemperatureSample) -> TemperatureSample:
            return replace(temperature, cpu_c=cpu_c)

        return lambda: change

    def battery(name: str, text: str, battery_v: float, stops: bool, lasts_s: float = FOR_EVER) -> Case:
        begin = _changed("power", volts(battery_v))
        resumes = not stops
        return Case(name, text, begin, _healed("power"), stops, lasts_s, resumes, 12.0, _SLOW_LIMIT_S)

    def heat(name: str, text: str, cpu_c: float, stops: bool) -> Case:
        begin = _changed("thermometer", degrees(cpu_c))
        return Case(name, text, begin, _healed("thermometer"), stops, 5.0, within_s=_SLOW_LIMIT_S)

    return [
        battery("battery-low", "battery at 6.1 V", 6.1, False),
        battery("battery-sag", "battery sags to 5.4 V for 0.3 s", 5.4, False, 0.3),
        battery("battery-empty", "battery at 5.4 V", 5.4, True),
        heat("hot-79", "processor at 79 °C", 79.0, False),
        heat("hot-90", "processor at 90 °C", 90.0, True),
    ]


def _links() -> list[Case]:
    def cut(system: Lockstep) -> None:
        system.cut_link()

    def mend(system: Lockstep) -> None:
        system.mend_link()

    return [
        Case("link-3s", "link dead for 3 s", cut, mend, True, _A_WHILE_S, True, 12.0, _SILENCE_LIMIT_S),
        Case("link", "link dead for 17 s", cut, mend, True, 17.0, False, 24.0, _SILENCE_LIMIT_S),
    ]


def _tasks() -> list[Case]:
    def case(row: Row, how: str, begin: Callable[[Lockstep], None], end: Callable[[Lockstep], None]) -> Case:
        within_s = _SILENCE_LIMIT_S if row is schedule.COMMANDS else LIMIT_S
        lasts_s = max(_A_WHILE_S, row.max_age_s + 1.0)  # until it is told that it hangs
        name = f"{row.name}-{'hung' if how == 'hangs' else 'fails'}"
        text = f"task {row.name} {how} for {lasts_s:.0f} s"
        watched_s = max(_WATCHED_S, 2 * lasts_s)
        return Case(name, text, begin, end, row in _STOPPING, lasts_s, True, watched_s, within_s)

    def hanging(row: Row) -> Case:
        return case(row, "hangs", lambda system: system.hang(row.name, True), lambda s: s.hang(row.name, False))

    def fail() -> None:
        raise RuntimeError("a bug")

    def spoil(_: object) -> None:
        fail()

    def failing(row: Row) -> Case:
        before: list[Callable[[], None]] = []

        def begin(system: Lockstep) -> None:
            before.append(system.replace_step(row.name, fail))

        def end(system: Lockstep) -> None:
            system.replace_step(row.name, before.pop())

        device = _READS.get(row)
        if device is not None:
            return case(row, "raises", _changed(device, lambda: spoil), _healed(device))
        return case(row, "raises", begin, end)

    return [*map(hanging, schedule.TABLE), *map(failing, schedule.TABLE)]
