"""Rules of the house that import-linter cannot express."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("shared", "robot_app", "station_gui", "tools")
# The runner, the guard round a task, and the boundary to Qt; everything else catches what it can name.
MAY_CATCH_ALL = {
    "shared/runtime/runner.py",
    "robot_app/app.py",
    "station_gui/qt/bridge.py",
    "station_gui/views/gl_canvas.py",
    "tools/fuzz/targets.py",  # that any exception comes out is what it looks for
}
LONGEST, LONGEST_KERNELS = 450, 600

Sources = dict[str, ast.Module]


@pytest.fixture(scope="module")
def sources() -> Sources:
    paths = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")]
    return {str(path.relative_to(ROOT)): ast.parse(path.read_text("utf-8")) for path in paths}


def imported(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            yield node.module


def kernels(tree: ast.AST) -> Iterator[tuple[str, str]]:
    """Name and decorator of every compiled function."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            for decorator in node.decorator_list:
                if "njit" in ast.unparse(decorator):
                    yield node.name, ast.unparse(decorator)


def test_only_the_clock_knows_the_time(sources: Sources) -> None:
    offenders = [n for n, tree in sources.items() if {"time", "datetime"} & set(imported(tree))]
    assert [n for n in offenders if n != "shared/runtime/clock.py" and not n.startswith("tools/")] == []


def test_random_numbers_come_in_as_generators(sources: Sources) -> None:
    allowed = {"default_rng", "Generator", "SeedSequence"}
    offenders = [
        f"{name}:{node.lineno}"
        for name, tree in sources.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Attribute)
        and node.value.attr == "random"
        and node.attr not in allowed
    ]
    assert offenders == []
    assert [name for name, tree in sources.items() if "random" in set(imported(tree))] == []


def test_kernels_are_plain(sources: Sources) -> None:
    plain = {"__future__", "math", "numpy", "numpy.typing", "numba", "typing", "collections.abc"}
    offenders = [
        f"{name} imports {module}"
        for name, tree in sources.items()
        if name.endswith("/_kernels.py") or name == "shared/geometry/rays.py"
        for module in imported(tree)
        if module not in plain and not module.endswith(("_kernels", "geometry.rays"))
    ]
    assert offenders == []


def test_every_kernel_lets_go_of_the_interpreter_and_is_kept_on_disk(sources: Sources) -> None:
    found = [(f"{name}: {kernel}", text) for name, tree in sources.items() for kernel, text in kernels(tree)]
    assert found
    assert [n for n, text in found if "nogil=True" not in text or "cache=True" not in text] == []
    assert [n for n, text in found if "fastmath" in text or "parallel" in text] == []


def test_only_the_boundaries_catch_everything(sources: Sources) -> None:
    offenders = [
        f"{name}:{node.lineno}"
        for name, tree in sources.items()
        if name not in MAY_CATCH_ALL
        for node in ast.walk(tree)
        if isinstance(node, ast.ExceptHandler)
        and (node.type is None or ast.unparse(node.type) in {"Exception", "BaseException"})
    ]
    assert offenders == []


def test_files_are_of_a_size_to_read(sources: Sources) -> None:
    lines = {name: len((ROOT / name).read_text("utf-8").splitlines()) for name in sources}
    limits = {name: LONGEST_KERNELS if name.endswith("/_kernels.py") else LONGEST for name in sources}
    assert {name: n for name, n in lines.items() if n > limits[name]} == {}
