from __future__ import annotations

import ctypes

import pytest

from robot_app.drivers.base import DeviceError
from tools.simulator.egl import EglContext


def current_context() -> int | None:
    egl = ctypes.CDLL("libEGL.so.1")
    egl.eglGetCurrentContext.restype = ctypes.c_void_p
    context: int | None = egl.eglGetCurrentContext()
    return context


def test_a_machine_without_egl_is_told_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(name: str) -> ctypes.CDLL:
        raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr("tools.simulator.egl.ctypes.CDLL", refuse)
    with pytest.raises(DeviceError, match="install libegl1"):
        EglContext()


def test_the_context_is_current_only_while_it_is_used_and_gives_way_to_the_one_before() -> None:
    outer, inner = EglContext(), EglContext()
    with outer.current():
        before = current_context()
        with inner.current():
            assert current_context() not in {before, None}
        assert current_context() == before
    assert current_context() is None
    for context in (outer, inner):
        context.close()
        context.close()
