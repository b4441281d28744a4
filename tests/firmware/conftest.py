"""Fixtures that build the firmware, and skip where that cannot be."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.firmware.benches import Bench, Core
from tools.simulator.devices.mega import StepMega
from tools.simulator.devices.mega_build import (
    BOOT_LOADER,
    MegaFiles,
    MegaUnavailableError,
    build_core_library,
    build_mega,
)


@pytest.fixture(scope="session")
def core_library() -> ctypes.CDLL:
    try:
        path = build_core_library()
    except MegaUnavailableError as error:
        pytest.skip(str(error))
    library = ctypes.CDLL(str(path))
    for name in ("arrive", "leave", "flood"):
        getattr(library, f"host_{name}").restype = ctypes.c_size_t
    library.host_flood.argtypes = [ctypes.c_char_p, ctypes.c_size_t, ctypes.c_size_t]
    library.host_arrive.argtypes = [ctypes.c_uint8, ctypes.c_char_p, ctypes.c_size_t]
    library.host_leave.argtypes = [ctypes.c_uint8, ctypes.c_char_p, ctypes.c_size_t]
    library.host_is_low.restype = ctypes.c_bool
    library.host_baud.restype = ctypes.c_uint32
    library.host_fed.restype = ctypes.c_uint32
    return library


@pytest.fixture
def core(core_library: ctypes.CDLL) -> Core:
    return Core(core_library)


@pytest.fixture(scope="session")
def mega_files() -> MegaFiles:
    try:
        return build_mega()
    except MegaUnavailableError as error:
        pytest.skip(str(error))


@pytest.fixture
def bench(mega_files: MegaFiles) -> Iterator[Bench]:
    with StepMega(mega_files) as mega:
        yield Bench(mega)


@pytest.fixture
def boot_loader() -> Path:
    if not BOOT_LOADER.is_file():
        pytest.skip("arduino-core-avr is not installed")
    return BOOT_LOADER
