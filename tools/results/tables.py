"""The tables of 2D SLAM in docs/results.md, from what was measured."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

Figures = dict[str, dict[str, dict[str, Any]]]  # by log, then by method

METHODS = ("graph", "particle")
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


def render(figures: Figures) -> str:
    """Everything between the marks; what was not measured is left out."""
    parts = [
        *_table("Mean absolute error ± standard deviation over the hand-made relations; particle filter with seed 0.",
                ("log", "graph", "particle filter", "Cartographer", "graph mapping", "GMapping's poses", "iris_lama"),
                _accuracy(figures)),
        *_table("Time and memory of the same runs, one core; the steps' times in ms.",
                ("log", "method", "s", "× real time", "step p50 / p99", "p99 of the first / last 1000", "peak memory",
                 "closures"), _cost(figures)),
        *_table("The logs of a URG-04LX (4 m, half of the beams without an echo) have no ground truth; `evaluate urg` "
                "measures walls of a metre and more, and how far the surfaces round the start are, at the last visit, "
                "from where the first scans put them. Lengths in mm unless marked.",
                ("log", "method", "walls", "thickness σ (within one scan)", "p95", "twice there", "scanner's noise",
                 "revisit: median / p95", "offset that aligns it"), _urg(figures)),
        *_table("The simulated lab with wheels that slip by 5 % and a biased gyro (`evaluate mission --scenario "
                "lab-slip --seeds 1-15`): mean and worst over the seeds.",
                ("method", "missions", "`pose_rmse_m`", "`map_rmse_m`", "`map_completeness`", "`collisions`",
                 "`goal_error_m`", "slip, mean of its size"), _lab(figures)),
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
        if log in figures:
            ours = (_error(figures[log].get(method)) for method in METHODS)
            yield (source.title, *ours, *source.published)


def _error(f: dict[str, Any] | None) -> str:
    if f is None:
        return ""
    return (
        f"{f['translation_mean_m']:.4f} ± {f['translation_std_m']:.4f} m, "
        f"{f['rotation_mean_deg']:.3f} ± {f['rotation_std_deg']:.3f}°"
    )


def _cost(figures: Figures) -> Iterator[tuple[str, ...]]:
    for log, method, f in _of(figures, list(CARMEN_LOGS)):
        yield (
            CARMEN_LOGS[log].title, method, f"{f['seconds']:.1f}", f"{f['realtime_factor']:.0f}",
            f"{f['step_ms_p50']:.2f} / {f['step_ms_p99']:.1f}",
            f"{f['step_ms_p99_first_1000']:.1f} / {f['step_ms_p99_last_1000']:.1f}",
            f"{f['peak_rss_mb']:.0f} MB", str(f["loop_closures"]),
        )  # fmt: skip


def _urg(figures: Figures) -> Iterator[tuple[str, ...]]:
    for log, method, f in _of(figures, list(URG_LOGS)):
        back = ("does not come back", "")
        if "revisit_offset_m" in f:
            apart = f"{_mm(f['revisit_median_m'])} / {_mm(f['revisit_p95_m'])}"
            back = (apart, f"{_mm(f['revisit_offset_m'])}, {f['revisit_offset_deg']:.2f}°")
        yield (
            log, method, f"{f['walls']}, {f['wall_length_m']:.0f} m",
            f"{_mm(f['wall_thickness_m'])} ({_mm(f['wall_scanner_m'])})", _mm(f["wall_p95_m"]),
            f"{f['double_walls']}, {f['double_length_m']:.1f} m", _mm(f["scanner_noise_m"]), *back,
        )  # fmt: skip


def _mm(value_m: float | None) -> str:
    return f"{1e3 * value_m:.0f}" if value_m is not None else "over 300"


def _lab(figures: Figures) -> Iterator[tuple[str, ...]]:
    for _, method, f in _of(figures, ["lab"]):
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
