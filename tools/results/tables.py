"""The tables of 2D SLAM in docs/results.md, from what was measured."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from tools.results import targets
from tools.results.targets import KIDNAPS, METHODS, Figures

BEGIN, END = "<!-- 2D SLAM: written by python -m tools.results -->", "<!-- 2D SLAM ends -->"


@dataclass(frozen=True, slots=True)
class Source:
    """`published`: mean absolute errors of Cartographer, graph mapping, GMapping's poses and iris_lama, as text."""

    title: str
    file: str
    relations: str
    published: tuple[str, str, str, str]


CARMEN_LOGS = {
    "intel": Source(
        "Intel", "intel.clf.bz2", "intel.relations.gz",
        ("0.0229 ± 0.0239 m, 0.453 ± 1.335°", "0.031 ± 0.026 m, 1.3 ± 4.7°", "0.054 ± 0.067 m, 2.19°",
         "0.0203 ± 0.0189 m, 0.349 ± 0.414°"),
    ),
    "fr079": Source(
        "FR079", "fr079.clf.bz2", "fr079.relations.gz",
        ("0.0452 ± 0.0354 m, 0.538 ± 0.718°", "0.056 ± 0.042 m, 0.6 ± 0.6°", "0.058 ± 0.042 m, 0.71°",
         "0.0372 ± 0.0277 m, 0.561 ± 0.959°"),
    ),
    "killian": Source(
        "MIT Killian", "mit-killian_restored.clf.bz2", "mit-killian.relations.gz",
        ("0.0395 ± 0.0488 m, 0.352 ± 0.353°", "0.050 ± 0.056 m, 0.5 ± 0.5°", "", "3.04 m (closes no loops)"),
    ),
}  # fmt: skip
URG_LOGS = {"exp1": "exp1.dat.gz", "exp2": "exp2.dat.gz", "test_lab2": "test_lab2.dat.gz"}
CONTINUED_LOGS = ("intel", "fr079")
ITEMS = {
    **{log: source.title for log, source in CARMEN_LOGS.items()}, **{log: log for log in URG_LOGS},
    "lab": "lab with slip", "kidnap": "kidnapped", "repeat": "FR079 again",
    "continued": "continued",
}  # fmt: skip


_TARGETS_WORDS = (
    "What was asked for and what was reached, worst case where there are several. Everything is measured through the "
    "SLAM that the station ships (`build_slam`), with the configuration that it ships. Times are by the clock, on a "
    "machine that others loaded, and beside it by CPU time, which tells slow code from a loaded machine. No figure "
    "was set for how straight a wall has to be: the 5 cm of a revisit stand for it. A row is measured again by `python "
    "-m tools.results --only NAME --methods METHOD`: intel, fr079, killian (which run `evaluate slam`), exp1, exp2, "
    "test_lab2 (`evaluate urg`), lab, kidnap, repeat (twice), continued."
)
_ACCURACY_WORDS = "Mean absolute error ± standard deviation over the hand-made relations; particle filter with seed 0."
_COST_WORDS = (
    "Time and memory of the same runs, one core, by the clock and by CPU time; the steps' times in ms. Scans lost are "
    "those at which the station did not know where the robot is."
)
_URG_WORDS = (
    "The logs of a URG-04LX (4 m, half of the beams without an echo) have no ground truth; `evaluate urg` measures "
    "walls of a metre and more, and how far the surfaces round the start are, at the last visit, from where the first "
    "scans put them. Which scans are the two visits is marked by hand. A wall is there twice where a second ridge "
    "stands up to 0.3 m beside it that no scan sees together with it, or where scans that face it look through it at "
    "a surface like it up to 1 m behind. Lengths in mm unless marked."
)
_LAB_WORDS = (
    "The simulated lab with wheels that slip by 5 % and a biased gyro (`evaluate mission --scenario lab-slip --seeds "
    "1-15`): mean and worst over the seeds; each seed's figures are in `slam2d.json`."
)
_KIDNAP_WORDS = (
    "Kidnapped in the lab's saved map (`evaluate kidnap`): found means a claim within 5 cm and 2°; elsewhere is a "
    "room that is not in the map, where every claim is wrong. Only the first claim counts; of a robot that is carried "
    "off the one that stands 2 s after, when it has to have been missed."
)
_CONTINUED_WORDS = (
    "A log in two sessions: the first half's map is stored, and a station that knows nothing else has to find the "
    "robot in it and go on. Relations between scans of the second half, once the robot is found, and the first one's "
    "keyframes."
)
_MEASURED_WORDS = (
    "Which state of the mapping each row was measured with: `code` is a hash of `station_gui/mapping` and its "
    "configuration, load how many tasks wanted one of the two cores when the run began. `python -m tools.results "
    "--stale` measures again what another state was measured with."
)


def render(figures: Figures) -> str:
    """Everything between the marks."""
    parts = [
        *_table(_TARGETS_WORDS,
                ("what", "method", "wanted", "measured", "met"), targets.rows(figures)),
        *_table(_ACCURACY_WORDS,
                ("log", "graph", "particle filter", "Cartographer", "graph mapping", "GMapping's poses", "iris_lama"),
                _accuracy(figures)),
        *_table(_COST_WORDS,
                ("log", "method", "s", "CPU s", "× real time", "by CPU", "step p50 / p99 / max", "by CPU",
                 "p99 of the first / last 1000", "by CPU", "peak memory", "closures", "scans lost",
                 "resampled, mean N_eff"), _cost(figures)),
        *_table(_URG_WORDS,
                ("log", "method", "walls", "thickness σ (within one scan)", "p95", "bend, mean / worst", "twice there",
                 "scanner's noise", "revisit: median / p95", "offset that aligns it", "scans lost"), _urg(figures)),
        *_table(_LAB_WORDS,
                ("method", "missions", "`pose_rmse_m`", "`map_rmse_m`", "`map_completeness`", "`collisions`",
                 "`goal_error_m`", "slip, mean of its size"), _lab(figures)),
        *_table(_KIDNAP_WORDS,
                ("how", "method", "found", "wrong", "lost", "s to find, p50 / p95", "error p95",
                 "elsewhere: lost, wrong"), _kidnap(figures)),
        *_table(_CONTINUED_WORDS,
                ("log", "method", "error", "relations", "found after", "scans lost, of", "map file"),
                _continued(figures)),
        *_table(_MEASURED_WORDS,
                ("commit", "code", "measured", "method", "load"), _measured(figures)),
        *_pictures(figures),
    ]  # fmt: skip
    return "\n".join(parts).rstrip() + "\n"


def with_section(text: str, section: str) -> str:
    """`text` with what stands between the marks replaced."""
    if text.count(BEGIN) != 1 or text.count(END) != 1 or text.index(BEGIN) > text.index(END):
        raise ValueError(f"the text needs one {BEGIN!r} and one {END!r} after it")
    before, rest = text.split(BEGIN)
    return f"{before}{BEGIN}\n\n{section}\n{END}{rest.split(END)[1]}"


def _table(words: str, head: tuple[str, ...], rows: Iterator[tuple[str, ...]]) -> Iterator[str]:
    body = [f"| {' | '.join(row)} |" for row in rows]
    if body:
        yield from (words, "", f"| {' | '.join(head)} |", "|" + "---|" * len(head), *body, "")


def _of(figures: Figures, logs: Iterator[str] | list[str]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    for log in logs:
        for method in METHODS:
            if method in figures.get(log, {}):
                yield log, method, figures[log][method]


def _accuracy(figures: Figures) -> Iterator[tuple[str, ...]]:
    for log, source in CARMEN_LOGS.items():
        ours = (_error(figures.get(log, {}).get(method)) for method in METHODS)
        yield (source.title, *ours, *source.published)


def _error(f: dict[str, Any] | None) -> str:
    if f is None:
        return "not measured"
    return (
        f"{f['translation_mean_m']:.4f} ± {f['translation_std_m']:.4f} m, "
        f"{f['rotation_mean_deg']:.3f} ± {f['rotation_std_deg']:.3f}°"
    )


def _cost(figures: Figures) -> Iterator[tuple[str, ...]]:
    for log, method, f in _of(figures, list(CARMEN_LOGS)):
        yield (
            CARMEN_LOGS[log].title, method, _number(f, "seconds", 1), _number(f, "cpu_seconds", 1),
            _number(f, "realtime_factor", 0), _number(f, "cpu_realtime_factor", 0),
            _numbers(f, ("step_ms_p50", 2), ("step_ms_p99", 1), ("step_ms_max", 0)),
            _numbers(f, ("step_cpu_ms_p50", 2), ("step_cpu_ms_p99", 1), ("step_cpu_ms_max", 0)),
            _numbers(f, ("step_ms_p99_first_1000", 1), ("step_ms_p99_last_1000", 1)),
            _numbers(f, ("step_cpu_ms_p99_first_1000", 1), ("step_cpu_ms_p99_last_1000", 1)),
            f"{f['peak_rss_mb']:.0f} MB", str(f["loop_closures"]), _number(f, "unlocated", 0),
            _resampled(f) if method == "particle" else "",
        )  # fmt: skip


def _resampled(f: dict[str, Any]) -> str:
    share = f.get("effective_share")
    return f"{f['resamplings']} times, {100 * share:.0f} % of the particles" if share is not None else "?"


def _number(f: dict[str, Any], key: str, digits: int) -> str:
    """`?` for what an older run did not measure."""
    return f"{f[key]:.{digits}f}" if f.get(key) is not None else "?"


def _numbers(f: dict[str, Any], *keys: tuple[str, int]) -> str:
    return " / ".join(_number(f, key, digits) for key, digits in keys)


def _urg(figures: Figures) -> Iterator[tuple[str, ...]]:
    for log, method, f in _of(figures, list(URG_LOGS)):
        back = ("saw too little", "")
        if "revisit_offset_m" in f:
            apart = f"{_mm(f['revisit_median_m'])} / {_mm(f['revisit_p95_m'])}"
            offset = "nothing aligns it"
            if f["revisit_offset_m"] is not None:
                offset = f"{_mm(f['revisit_offset_m'])}, {f['revisit_offset_deg']:.2f}°"
            back = (apart, offset)
        yield (
            log, method, f"{f['walls']}, {f['wall_length_m']:.0f} m",
            f"{_mm(f['wall_thickness_m'])} ({_mm(f['wall_scanner_m'])})", _mm(f["wall_p95_m"]),
            f"{_mm(f['wall_bend_m'])} / {_mm(f['wall_bend_worst_m'])}",
            f"{f['double_walls']}, {f['double_length_m']:.1f} m", _mm(f["scanner_noise_m"]), *back,
            _number(f, "unlocated", 0),
        )  # fmt: skip


def _kidnap(figures: Figures) -> Iterator[tuple[str, ...]]:
    for kind, title, method in KIDNAPS:
        f = figures.get("kidnap", {}).get(method, {}).get(kind)
        if f is None:
            yield (title, method, "not measured", "", "", "", "", "")
            continue
        yield (
            title, method, f"{f['found']} of {f['trials']}", str(f["wrong"]), str(f["lost"]),
            _numbers(f, ("seconds_to_find_p50", 1), ("seconds_to_find_p95", 1)),
            f"{_mm(f['error_m_p95'])} mm, {_number(f, 'error_deg_p95', 2)}°",
            f"{f['elsewhere_lost']}, {f['elsewhere_wrong']}",
        )  # fmt: skip


def _continued(figures: Figures) -> Iterator[tuple[str, ...]]:
    for log in CONTINUED_LOGS:
        for method in METHODS:
            f = figures.get("continued", {}).get(method, {}).get(log)
            if f is None:
                yield (CARMEN_LOGS[log].title, method, "not measured", "", "", "", "")
                continue
            yield (
                CARMEN_LOGS[log].title, method, _error(f), str(f["relations"]), f"{f['found_after']} scans",
                f"{f['unlocated']}, {f['scans']}", f"{f['map_bytes'] / 1e6:.1f} MB",
            )  # fmt: skip


def _measured(figures: Figures) -> Iterator[tuple[str, ...]]:
    for log, method, f in _of(figures, list(ITEMS)):
        at = f.get("measured_at", {"commit": "before this was noted", "code": "?", "load": "?"})
        yield (at["commit"], at["code"], ITEMS[log], method, str(at["load"]))


def _mm(value_m: float | None) -> str:
    return f"{1e3 * value_m:.0f}" if value_m is not None else "over 300"


def _lab(figures: Figures) -> Iterator[tuple[str, ...]]:
    for method in METHODS:
        f = figures.get("lab", {}).get(method)
        if f is None:
            yield (method, "not measured", "", "", "", "", "", "")
            continue
        mean, worst = f["mean"], f["worst"]
        done = "all finished" if f["finished"] else "not all finished"
        columns = (
            f"{mean[key]:.3g}, {worst[key]:.3g}" if key in mean else ""
            for key in ("pose_rmse_m", "map_rmse_m", "map_completeness", "collisions", "goal_error_m")
        )
        yield (method, f"{len(f['seeds'])}, {done}", *columns, f"{100 * mean['encoder_slip_mean_abs']:.0f} %")


def _pictures(figures: Figures) -> Iterator[str]:
    titles = {log: source.title for log, source in CARMEN_LOGS.items()} | {log: log for log in URG_LOGS}
    logs = [log for log in titles if log in figures]
    if logs:
        yield from ("| log | graph | particle filter |", "|---|---|---|")
    for log in logs:
        shown = (
            f"![{titles[log]}, {method}](images/{log}-{method}.png)" if method in figures[log] else ""
            for method in METHODS
        )
        yield f"| {titles[log]} | {' | '.join(shown)} |"
