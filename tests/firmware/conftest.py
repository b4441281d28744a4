"""Fixtures that build the firmware, and skip where that cannot be."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.firmware.benches import Bench
from tools.simulator.devices.mega import StepMega
from tools.simulator.devices.mega_build import (
    BOOT_LOADER,
    MegaFiles,
    MegaUnavailableError,
    build_core_library,
    build_mega,
)
from tools.simulator.devices.mega_core import Core


@pytest.fixture(scope="session")
def core_library() -> Path:
    try:
        return build_core_library()
    except MegaUnavailableError as error:
        pytest.skip(str(error))


@pytest.fixture
def core(core_library: Path) -> Core:
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
