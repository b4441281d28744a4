"""`evaluate codec`: what observations cost in profile COMPACT, what they lose, and what other packings take."""

from __future__ import annotations

import argparse
import json
import math
import statistics
import tempfile
import time
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from robot_app.config import load_config as load_robot
from robot_app.perception.config import TrackingConfig
from robot_app.perception.identity.tracker import ObjectTracker
from shared.command_line import EXIT_FAILED, EXIT_MISUSE, EXIT_OK, existing_file, seed
from shared.messages import Observation
from shared.protocol.codec import Decoder as FullDecoder
from shared.protocol.compact.decoder import Decoder
from shared.protocol.compact.encoder import DETAILS, Encoder
from shared.recording import MissionReader
from station_gui.config import load_config as load_station
from tools.evaluate.link.packings import PACKINGS, PAPER_LORA_BYTES, PAPER_WIFI_BYTES
from tools.evaluate.link.quiet import quiet
from tools.logs.base import LogError
from tools.logs.urg import UrgReader
from tools.simulator.lockstep import run_mission
from tools.simulator.scenario import find_scenario

_BEAMS = 227
_EVERY = 3


@dataclass(slots=True)
class Tally:
    """Over one sequence of observations."""

    sizes: list[int] = field(default_factory=list)
    pose: list[int] = field(default_factory=list)
    alignment: list[int] = field(default_factory=list)
    scan: list[int] = field(default_factory=list)
    objects: list[int] = field(default_factory=list)
    levels: list[int] = field(default_factory=list)
    keyframes: list[int] = field(default_factory=list)
    encode_ms: list[float] = field(default_factory=list)
    decode_ms: list[float] = field(default_factory=list)
    decoded: int = 0
    range_error_m: float = 0.0
    node_error_m: float = 0.0
    lost_beams: int = 0
    lost_nodes: int = 0
    others: dict[str, list[int]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Channel:
    """`loss`: share of the datagrams; `delay`: observations until an acknowledgement is back, 0 for a link in order."""

    loss: float
    delay: int
    budget: int | None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("logs", nargs="*", metavar="LOG", type=existing_file, help="URG-04LX logs or missions (.mcap)")
    parser.add_argument(
        "--lab", action="store_true", help="drive a mission in the lab, in lock-step, and take that too"
    )
    parser.add_argument(
        "--corrected",
        action="store_true",
        help="the logs' distances without the scanner's wave, which has fractions of a "
        "millimetre (default: the whole millimetres that it sent, as they come off the wire)",
    )
    parser.add_argument("--seed", type=seed, default=1, help="of the mission and of the losses (default: 1)")
    parser.add_argument("--loss", type=float, default=0.0, metavar="SHARE", help="of the datagrams, as 0.2")
    parser.add_argument(
        "--delay",
        type=int,
        default=0,
        metavar="N",
        help="acknowledge: N observations until it is back (default: link in order)",
    )
    parser.add_argument("--budget", type=int, metavar="BYTES", help="that an observation may take")
    parser.add_argument("--json", action="store_true", help="print one JSON object as the last line")


def run(args: argparse.Namespace) -> int:
    """Exit code 1 when an observation did not come through on a link without loss."""
    if args.loss > 0 and args.delay < 1:
        args.delay = 1
    channel = Channel(args.loss, args.delay, args.budget)
    reports: dict[str, dict[str, float]] = {}
    status = EXIT_OK
    for name, observations in _sources(args):
        tally = measure(observations, channel, np.random.default_rng(args.seed))
        reports[name] = figures(tally)
        for key, value in reports[name].items():
            print(f"{name:12} {key:28} {value}")
        if channel.loss == 0 and tally.decoded < len(tally.sizes):
            status = EXIT_FAILED
    if not reports:
        print("name a log, or --lab")
        return EXIT_MISUSE
    if args.json:
        paper = {"paper_lora_bytes": PAPER_LORA_BYTES, "paper_wifi_bytes": PAPER_WIFI_BYTES}
        print(json.dumps({"logs": reports, "loss": args.loss, "delay": args.delay, "budget": args.budget} | paper))
    return status


def _sources(args: argparse.Namespace) -> Iterable[tuple[str, list[Observation]]]:
    for log in args.logs:
        yield observations_of(log, args.corrected)
    if args.lab:
        with quiet(args.verbose):
            observations = lab_mission(args.seed)
        yield "lab", observations


def observations_of(log: Path, corrects: bool = False) -> tuple[str, list[Observation]]:
    """A log's name and what is in it; `corrects`: what the scanner gets wrong in a URG-04LX log."""
    name = log.name.split(".")[0]
    return name, recorded(log) if log.suffix == ".mcap" else [thinned(o) for o in UrgReader(log, corrects=corrects)]


def recorded(path: Path) -> list[Observation]:
    """The observations of a recorded mission, with their objects held still as the robot holds them for LoRa."""
    decoder, tracker = FullDecoder(), ObjectTracker(TrackingConfig())
    messages = (decoder.decode(record.datagram) for record in MissionReader(path))
    observations = [tracker.steadied(message) for message in messages if isinstance(message, Observation)]
    if not observations:
        raise LogError(f"{path}: holds no observation")
    return observations


def lab_mission(number: int, ends_s: float | None = None) -> list[Observation]:
    """The observations of the demo's mission, as the station got them; with `ends_s` those of its beginning."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mission.mcap"
        run_mission(
            find_scenario("lab"), number, load_robot(None), load_station(None),
            say=lambda _: None, progress=lambda _: None, recording=path, ends_s=ends_s,
        )  # fmt: skip
        return recorded(path)


def thinned(observation: Observation) -> Observation:
    """Every third beam, as the robot's own scanner is read."""
    geometry = observation.geometry
    first = (len(observation.ranges_m) - _EVERY * (_BEAMS - 1)) // 2
    return replace(
        observation,
        ranges_m=observation.ranges_m[first::_EVERY][:_BEAMS],
        geometry=replace(
            geometry,
            first_angle_rad=geometry.first_angle_rad + first * geometry.step_rad,
            step_rad=_EVERY * geometry.step_rad,
            beam_interval_s=_EVERY * geometry.beam_interval_s,
        ),
    )


def measure(observations: list[Observation], channel: Channel, rng: np.random.Generator) -> Tally:
    """All observations through encoder, channel and decoder."""
    tally = Tally()
    encoder, decoder = Encoder(in_order=channel.delay == 0), Decoder()
    answers: deque[bytes] = deque()
    _warm_up(observations[:2])
    for observation in observations:
        began_s = time.perf_counter()
        encoded = encoder.encode(observation, channel.budget)
        tally.encode_ms.append(1e3 * (time.perf_counter() - began_s))
        tally.sizes.append(len(encoded.datagram))
        tally.pose.append(encoded.sizes.pose)
        tally.alignment.append(encoded.sizes.alignment - encoded.sizes.pose)
        tally.scan.append(encoded.sizes.scan - encoded.sizes.pose)
        tally.objects.append(encoded.sizes.objects - encoded.sizes.scan)
        tally.levels.append(encoded.level)
        if encoded.keyframe:
            tally.keyframes.append(len(encoded.datagram))
        if rng.random() >= channel.loss:
            began_s = time.perf_counter()
            received = decoder.decode(encoded.datagram)
            tally.decode_ms.append(1e3 * (time.perf_counter() - began_s))
            if received is not None:
                _compare(observation, received, tally)
        if channel.delay > 0:
            answers.append(decoder.feedback())
            if len(answers) >= channel.delay:
                encoder.acknowledge(answers.popleft())
    for name, size in PACKINGS.items():
        tally.others[name] = [size(observation) for observation in observations]
    return tally


def _warm_up(observations: list[Observation]) -> None:
    """Compile what is not yet compiled."""
    encoder, decoder = Encoder(in_order=True), Decoder()
    for observation in observations:
        decoder.decode(encoder.encode(observation).datagram)


def _compare(sent: Observation, received: Observation, tally: Tally) -> None:
    tally.decoded += 1
    both = np.isfinite(sent.ranges_m) & np.isfinite(received.ranges_m)
    tally.lost_beams += int(np.isfinite(sent.ranges_m).sum() - both.sum())
    if both.any():
        off_m = np.abs(sent.ranges_m.astype(np.float64) - received.ranges_m.astype(np.float64))[both].max()
        tally.range_error_m = max(tally.range_error_m, float(off_m))
    nodes, got = sent.objects.nodes_m, received.objects.nodes_m
    tally.lost_nodes += max(0, len(nodes) - len(got))
    if len(nodes) and len(got) >= len(nodes):
        off = np.linalg.norm(nodes[:, None, :] - got[None, :, :], axis=2).min(axis=1)
        tally.node_error_m = max(tally.node_error_m, float(off.max()))


def figures(tally: Tally) -> dict[str, float]:
    """Means over all observations; bytes_per_observation is the whole datagram, its four bytes of head included.

    bytes_alignment are of those of the scan.
    """
    report: dict[str, float] = {
        "observations": len(tally.sizes),
        "decoded": tally.decoded,
        "bytes_per_observation": statistics.fmean(tally.sizes),
        "bytes_p99": float(np.percentile(tally.sizes, 99)),
        "bytes_pose": statistics.fmean(tally.pose),
        "bytes_scan": statistics.fmean(tally.scan),
        "bytes_alignment": statistics.fmean(tally.alignment),
        "bytes_objects": statistics.fmean(tally.objects),
        "keyframes": len(tally.keyframes),
        "keyframe_bytes": statistics.fmean(tally.keyframes) if tally.keyframes else 0.0,
        "range_error_m": round(tally.range_error_m, 6),
        "node_error_m": tally.node_error_m,
        "lost_beams": tally.lost_beams,
        "lost_nodes": tally.lost_nodes,
        "reduced": sum(level > 0 for level in tally.levels),
        "encode_ms_p50": statistics.median(tally.encode_ms),
        "encode_ms_p99": float(np.percentile(tally.encode_ms, 99)),
        "decode_ms_p50": statistics.median(tally.decode_ms) if tally.decode_ms else 0.0,
    }
    report |= {f"reduced_to_{k}": tally.levels.count(k) for k in range(1, len(DETAILS)) if k in tally.levels}
    report |= {f"bytes_{name}": statistics.fmean(sizes) for name, sizes in tally.others.items() if sizes}
    return {
        key: value if isinstance(value, int) or not math.isfinite(value) else round(value, 6)
        for key, value in report.items()
    }
