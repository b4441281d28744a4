"""`python -m tools.results`: the figures, tables and maps of 2D SLAM in docs/, measured again.

Every figure is kept in docs/slam2d.json, so that a part can be measured again by itself.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from shared.command_line import EXIT_OK, Parser, Refused, run
from tools.evaluate.kidnap import trial_count
from tools.evaluate.seeds import seed_list
from tools.results.code_state import mapping_code, measured_at
from tools.results.tables import CARMEN_LOGS, CONTINUED_LOGS, ITEMS, URG_LOGS, render, with_section
from tools.results.targets import KIDNAPS, METHODS, Figures

_ROOT = Path(__file__).resolve().parents[2]
_TIMEOUT_S = 3 * 3600
_KIDNAP_OPTIONS = {"put_down": ("--elsewhere", "40"), "localise": ("--localise",), "carried": ("--carried",)}
_LAB_KEYS = (
    "seed", "finished", "pose_rmse_m", "map_rmse_m", "map_completeness", "collisions", "goal_error_m", "duration_s",
    "loop_closures", "encoder_slip_net", "encoder_slip_mean_abs", "gyro_bias_dps",
)  # fmt: skip


def _parser() -> argparse.ArgumentParser:
    everything = list(ITEMS)
    parser = Parser(prog="results", description=__doc__)
    parser.add_argument("--data", type=Path, default=_ROOT.parent / "shared" / "data", help="the recorded logs")
    parser.add_argument("--docs", type=Path, default=_ROOT / "docs", help="where results.md is (default: docs)")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS), metavar="METHOD")
    parser.add_argument(
        "--only", nargs="*", choices=everything, default=everything, metavar="LOG",
        help=f"of {', '.join(everything)}; nothing after it writes the tables of what was measured before",
    )  # fmt: skip
    parser.add_argument("--stale", action="store_true", help="only what another state of the mapping was measured with")
    parser.add_argument("--trials", type=trial_count, default=100, help="of each kidnapping (default: 100)")
    parser.add_argument("--seeds", type=seed_list, default=seed_list("1-15"), help="of the lab (default: 1-15)")
    return parser


def _work() -> int:
    args = _parser().parse_args()
    store, text = args.docs / "slam2d.json", args.docs / "results.md"
    figures: Figures = json.loads(store.read_text("utf-8")) if store.is_file() else {}
    for method in args.methods:
        for log in args.only:
            if args.stale and _is_fresh(figures, log, method):
                continue
            print(f"{log}, {method}", file=sys.stderr, flush=True)
            at = measured_at()
            measured = _measured(log, method, args)
            figures.setdefault(log, {})[method] = measured | {"measured_at": at}
            store.write_text(json.dumps(figures, indent=1, sort_keys=True) + "\n", "utf-8")
    text.write_text(with_section(text.read_text("utf-8"), render(figures)), "utf-8")
    return EXIT_OK


def _is_fresh(figures: Figures, log: str, method: str) -> bool:
    at: dict[str, Any] = figures.get(log, {}).get(method, {}).get("measured_at", {})
    return at.get("code") == mapping_code()


def _measured(log: str, method: str, args: argparse.Namespace) -> dict[str, Any]:
    if log == "lab":
        return _lab(method, args.seeds)
    if log == "kidnap":
        return _kidnap(method, args.trials)
    if log == "repeat":
        return _repeat(method, args.data)
    if log == "continued":
        return {name: _continued(name, method, args.data) for name in CONTINUED_LOGS}
    return _log(log, method, args.data, args.docs)


def _log(log: str, method: str, data: Path, docs: Path) -> dict[str, Any]:
    picture = docs / "images" / f"{log}-{method}.png"
    options = ["--method", method, "--picture", str(picture)]
    if log in CARMEN_LOGS:
        source = CARMEN_LOGS[log]
        options += ["--title", f"{source.title}, {method}", "--relations", str(data / "slam" / source.relations)]
        return _json_of("tools.results.one_log", str(data / "slam" / source.file), *options)
    options += ["--title", f"URG-04LX {log}, {method}"]
    return _json_of("tools.results.one_log", str(data / "urg04lx" / URG_LOGS[log]), *options)


def _lab(method: str, seeds: tuple[int, ...]) -> dict[str, Any]:
    numbers = ",".join(map(str, seeds))
    whole = _json_of(
        "tools.evaluate", "mission", "--scenario", "lab-slip", "--seeds", numbers, "--method", method, "--json"
    )
    runs = [{key: run[key] for key in _LAB_KEYS} for run in whole["runs"]]
    return {key: whole[key] for key in ("seeds", "finished", "mean", "worst")} | {"runs": runs}


def _kidnap(method: str, trials: int) -> dict[str, Any]:
    kinds = [kind for kind, _, mapped_by in KIDNAPS if mapped_by == method]
    options = ("--method", method, "--trials", str(trials), "--json")
    return {kind: _json_of("tools.evaluate", "kidnap", *_KIDNAP_OPTIONS[kind], *options) for kind in kinds}


def _continued(log: str, method: str, data: Path) -> dict[str, Any]:
    source = CARMEN_LOGS[log]
    words = (str(data / "slam" / source.file), "--relations", str(data / "slam" / source.relations), "--method", method)
    return _json_of("tools.results.one_log", *words, "--continued")


def _repeat(method: str, data: Path) -> dict[str, Any]:
    """The same log twice, each time in a process of its own."""
    source = CARMEN_LOGS["fr079"]
    words = (str(data / "slam" / source.file), "--relations", str(data / "slam" / source.relations), "--method", method)
    hashes = [_json_of("tools.results.one_log", *words)["trajectory_sha256"] for _ in range(2)]
    return {"different_runs": len(set(hashes)) - 1, "trajectory_sha256": hashes}


def _json_of(module: str, *arguments: str) -> dict[str, Any]:
    """The last line of a process of its own: its memory and its first compilation are nobody else's."""
    done = subprocess.run(
        [sys.executable, "-m", module, *arguments],
        cwd=_ROOT, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False,
    )  # fmt: skip
    lines = done.stdout.strip().splitlines()
    if not lines or not lines[-1].startswith("{"):
        said = done.stderr.strip().splitlines()[-1:] or [f"ended with {done.returncode}"]
        raise Refused(f"{module} {' '.join(arguments)}: {said[0]}")
    answer: dict[str, Any] = json.loads(lines[-1])
    return answer


def main() -> int:
    return run("results", _work)


if __name__ == "__main__":
    sys.exit(main())
