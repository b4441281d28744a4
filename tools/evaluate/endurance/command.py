"""`evaluate endurance`: the robot app at real time, its simulator and the station in other processes.

The app is a process of its own: its schedule, memory and processor time are its own. The simulator (physics and
rendering, nice 5) and the station (this process, nice 10) would not be on the robot's processor; where all cores are
busy their work makes the app late all the same.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import statistics
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from shared.command_line import EXIT_FAILED, EXIT_OK, number_in, seed
from shared.messages import MissionState
from shared.runtime.clock import MonotonicClock
from shared.runtime.runner import ThreadRunner
from station_gui.build import build_station
from station_gui.config import load_config as load_station
from station_gui.model.station import Station
from tools.demo_robot import program
from tools.simulator.scenario import find_scenario

_SETTLES_S = 60.0  # until then memory may grow
_AVERAGED = 10  # samples of the memory at either end, one each second
_NICE = 10
_LEAST_RATE, _MOST_LATE, _MOST_GROWTH_MB, _MOST_CORES = 0.99, 0.005, 1.0, 1.0
_FAST_HZ = 100.0
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True, slots=True)
class RowFigures:
    name: str
    rate_share: float  # of the rate in the schedule
    late_share: float  # of the ticks, by more than 5 ms
    latest_ms: float
    over_budget_share: float
    longest_ms: float  # processor time of a tick
    cores: float


@dataclass(frozen=True, slots=True)
class Sample:
    time_s: float
    memory_mb: float
    processor_s: float


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=number_in(10, 36_000), default=600.0, help="how long (default: 600)")
    parser.add_argument("--scenario", default="lab", help="a scenario's name (default: lab)")
    parser.add_argument("--seed", type=seed, default=1, help="of all noise (default: 1)")
    parser.add_argument("--json", action="store_true", help="print one JSON object as the last line")


def run(args: argparse.Namespace) -> int:
    find_scenario(args.scenario)  # refused here rather than in the robot's process
    logging.getLogger("station").setLevel(logging.WARNING)
    os.nice(_NICE)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        figures = out / "figures.json"
        arguments = ["--scenario", args.scenario, "--seed", str(args.seed), str(figures)]
        with program("tools.evaluate.endurance.robot", arguments, out / "ready.json", out) as said:
            ready = json.loads(said)
            samples = _drive(args, ready["port"], ready["robot"])
        measured = json.loads(figures.read_text("utf-8"))
    result = _result(measured, samples)
    _print(result)
    if args.json:
        print(json.dumps(result))
    return EXIT_OK if result["kept"] else EXIT_FAILED


def _drive(args: argparse.Namespace, port: int, robot: int) -> list[Sample]:
    """A mission, and then from goal to goal until the time is over."""
    clock = MonotonicClock()
    station = build_station(load_station(None), clock, 1, name_recording=lambda: None)
    runner = ThreadRunner(station.tasks(), clock, station.on_fault)
    runner.start()
    samples: list[Sample] = []
    try:
        station.connect("127.0.0.1", port)
        orders = _orders(station, find_scenario(args.scenario).goals_in_start_frame_m())
        while clock.now_s() < args.seconds:
            next(orders)
            if clock.now_s() >= len(samples):
                samples.append(sample_of(robot, clock.now_s()))
            time.sleep(0.1)
        station.stop()
        time.sleep(0.5)
    finally:
        runner.stop()
        station.close()
    return samples


def _orders(station: Station, goals_m: tuple[tuple[float, float], ...]) -> Iterator[None]:
    """Ten times a second."""
    number = waited = 0
    while True:
        view = station.view()
        state = view.telemetry.state if view.telemetry is not None else None
        waited += 1
        if state in {MissionState.IDLE, MissionState.HALTED} and waited > 10:
            waited = 0
            station.start()
        elif state is MissionState.COMMAND and view.goal_m is None and waited > 20 and goals_m:
            waited = 0
            station.go_to(*goals_m[number % len(goals_m)])
            number += 1
        yield


def sample_of(process_id: int, time_s: float) -> Sample:
    """Of the process alone, not of those that it has started."""
    status = Path(f"/proc/{process_id}/status").read_text("ascii")
    resident_kb = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS"))
    spent = Path(f"/proc/{process_id}/stat").read_text("ascii").rpartition(") ")[2].split()
    return Sample(time_s, resident_kb / 1024, (int(spent[11]) + int(spent[12])) / _TICKS_PER_S)


def growth_mb(samples: list[Sample]) -> float | None:
    """After the first minute; None of a shorter run."""
    settled = [s.memory_mb for s in samples if s.time_s >= _SETTLES_S]
    if len(settled) < 2 * _AVERAGED:
        return None
    return statistics.median(settled[-_AVERAGED:]) - statistics.median(settled[:_AVERAGED])


def row_figures(name: str, row: dict[str, float], ran_s: float) -> RowFigures:
    ticks = max(1.0, row["ticks"])
    return RowFigures(
        name,
        rate_share=round(row["ticks"] / (row["rate_hz"] * ran_s), 4),
        late_share=round(row["late"] / ticks, 5),
        latest_ms=round(1e3 * row["latest_s"], 1),
        over_budget_share=round(row["over_budget"] / ticks, 4),
        longest_ms=round(1e3 * row["longest_s"], 1),
        cores=round(row["busy_s"] / ran_s, 4),
    )


def _result(measured: dict[str, dict[str, dict[str, float]]], samples: list[Sample]) -> dict[str, object]:
    ran_s = float(measured["ran_s"])  # type: ignore[arg-type]
    rows = [row_figures(name, row, ran_s) for name, row in measured["rows"].items()]
    fast = [r for r in rows if measured["rows"][r.name]["rate_hz"] >= _FAST_HZ]
    late = max((r.late_share for r in fast), default=0.0)
    rate = min(r.rate_share for r in rows)
    cores = (samples[-1].processor_s - samples[0].processor_s) / (samples[-1].time_s - samples[0].time_s)
    growth = growth_mb(samples)
    missed = [
        words
        for words, is_missed in (
            (f"a row kept {rate:.4f} of its rate: {_LEAST_RATE} is wanted", rate < _LEAST_RATE),
            (f"{late:.4f} of the 100 Hz ticks were late: under {_MOST_LATE} is wanted", late >= _MOST_LATE),
            (f"{cores:.2f} cores: under {_MOST_CORES:g} is wanted", cores >= _MOST_CORES),
            (f"memory grew: under {_MOST_GROWTH_MB:g} MB is wanted", growth is not None and growth >= _MOST_GROWTH_MB),
        )
        if is_missed
    ]
    return {
        "ran_s": round(ran_s, 1),
        "kept": not missed,
        "missed": missed,
        "least_rate_share": rate,
        "late_share_100hz": late,
        "memory_growth_mb": None if growth is None else round(growth, 2),
        "memory_mb": round(samples[-1].memory_mb, 1),
        "cores": round(cores, 3),
        "nice": measured["nice"],
        "simulator": measured["simulator"],
        "rows": [asdict(r) for r in rows],
        "memory_each_minute_mb": [round(s.memory_mb, 2) for s in samples[:: int(_SETTLES_S)]],
    }


def _print(result: dict[str, object]) -> None:
    rows = result["rows"]
    assert isinstance(rows, list)
    columns = ("rate_share", "late_share", "latest_ms", "over_budget_share", "longest_ms", "cores")
    print(f"{'row':12}" + "".join(f"{c:>18}" for c in columns))
    for row in rows:
        print(f"{row['name']:12}" + "".join(f"{row[c]:>18}" for c in columns))
    for key, value in result.items():
        if key != "rows":
            print(f"{key:24} {value}")
