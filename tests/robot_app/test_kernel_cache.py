from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from robot_app.kernel_cache import compile_all

_PROGRAM = """
import os
from numba import njit
from robot_app.kernel_cache import compile_all

@njit(cache=True)
def kernel(x):
    return x + 1

compile_all(lambda: print(kernel(1)), os.environ["NUMBA_CACHE_DIR"])
"""


def test_kernels_that_a_power_cut_has_spoilt_are_compiled_anew(tmp_path: Path) -> None:
    program, kept = tmp_path / "program.py", tmp_path / "kept"
    program.write_text(_PROGRAM, "utf-8")

    def run() -> str:
        environment = os.environ | {"NUMBA_CACHE_DIR": str(kept)}
        done = subprocess.run(
            [sys.executable, str(program)], env=environment, capture_output=True, text=True, check=True
        )
        return done.stdout

    run()
    compiled = next(kept.rglob("*.nbc"))
    for spoilt in (b"", compiled.read_bytes()[:100]):
        compiled.write_bytes(spoilt)
        assert run() == "2\n"
    assert compiled.stat().st_size > 100


def test_a_fault_that_is_none_of_the_kept_kernels_is_told(tmp_path: Path) -> None:
    def fail() -> None:
        raise IndexError("a bug")

    for folder in (None, str(tmp_path)):
        with pytest.raises(IndexError):
            compile_all(fail, folder)


def test_what_was_compiled_is_forced_to_the_card(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[bool] = []
    monkeypatch.setattr("os.sync", lambda: synced.append(True))
    compile_all((tmp_path / "kernel.nbc").touch, str(tmp_path))
    compile_all(lambda: None, str(tmp_path))
    assert synced == [True]
