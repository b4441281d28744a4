"""The emulated Mega itself: what it is started with, and that nothing of it stays behind."""

from __future__ import annotations

from pathlib import Path

import pytest

from tools.simulator.devices import mega_build
from tools.simulator.devices.mega import LiveMega, MegaError, MegaEvent, StepMega
from tools.simulator.devices.mega_build import MegaFiles, MegaUnavailableError, build_core_library, build_mega


@pytest.mark.parametrize("kind", [StepMega, LiveMega])
def test_what_is_no_firmware_is_refused(
    mega_files: MegaFiles, tmp_path: Path, kind: type[StepMega] | type[LiveMega]
) -> None:
    wrong = tmp_path / "wrong.hex"
    wrong.write_text("this is no hex\n")
    with pytest.raises(MegaError, match=r"wrong\.hex"):
        kind(MegaFiles(mega_files.host, wrong))


def test_a_missing_boot_loader_is_named(mega_files: MegaFiles, tmp_path: Path) -> None:
    with pytest.raises(MegaUnavailableError, match="arduino-core-avr"):
        StepMega(mega_files, tmp_path / "none.hex")
    with pytest.raises(MegaUnavailableError, match="arduino-core-avr"):
        LiveMega(mega_files, tmp_path / "none.hex")


def test_an_emulation_that_dies_is_an_error(mega_files: MegaFiles) -> None:
    with StepMega(mega_files) as mega:
        mega._program._process.kill()
        with pytest.raises(MegaError, match="has ended"):
            mega.run(1_000)


def test_more_than_it_can_hold_is_refused(mega_files: MegaFiles) -> None:
    with StepMega(mega_files) as mega, pytest.raises(ValueError, match="at once"):
        mega.run(1_000, bytes(10_000))


def test_time_goes_on_as_asked_and_the_ports_have_their_rates(mega_files: MegaFiles) -> None:
    with StepMega(mega_files) as mega:
        first, second = mega.run(10_000), mega.run(250)
    assert first.now_us == pytest.approx(10_000, abs=60)
    assert second.now_us - first.now_us == pytest.approx(250, abs=60)
    rates = {event.values for event in first.events if event.kind == "baud"}
    assert rates == {(0, 500_000), (1, 117_647), (2, 117_647)}
    assert MegaEvent("reset") not in second.events


@pytest.mark.parametrize("missing", ["avr-gcc", "cc", "make"])
def test_what_is_missing_to_build_is_named(missing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mega_build.shutil, "which", lambda tool: None if tool == missing else "/usr/bin/" + tool)
    with pytest.raises(MegaUnavailableError, match=f"{missing} is missing"):
        build_mega()
    if missing != "avr-gcc":
        with pytest.raises(MegaUnavailableError, match="make or cc"):
            build_core_library()


def test_a_build_that_fails_shows_why(tmp_path: Path) -> None:
    (tmp_path / "Makefile").write_text("all:\n\t@echo it broke >&2; false\n")
    with pytest.raises(MegaUnavailableError, match="it broke"):
        mega_build._make(tmp_path, "all", tmp_path)


@pytest.mark.parametrize("kind", [StepMega, LiveMega])
def test_it_ends_when_whoever_started_it_is_gone(mega_files: MegaFiles, kind: type[StepMega] | type[LiveMega]) -> None:
    with kind(mega_files) as mega:
        process = mega._program._process
        assert process.stdin is not None
        process.stdin.close()  # as the system does for a program that was killed
        assert process.wait(10.0) == 0
