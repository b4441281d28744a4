from __future__ import annotations

from pathlib import Path

import pytest

from robot_app.drivers.base import DeviceError
from robot_app.drivers.config import ThermometerConfig
from robot_app.drivers.thermometer import CpuThermometer
from shared.runtime.clock import ManualClock


@pytest.fixture
def config(tmp_path: Path) -> ThermometerConfig:
    (tmp_path / "temp").write_text("61342\n")
    return ThermometerConfig(str(tmp_path / "temp"), str(tmp_path), str(tmp_path / "get_throttled"))


def test_the_temperature_is_read(config: ThermometerConfig) -> None:
    thermometer = CpuThermometer(config, ManualClock(7.0))
    sample = thermometer.read(0.0)
    assert (sample.stamp_s, sample.cpu_c) == (7.0, 61.342)
    assert (sample.throttling, sample.fan) == ((), None)


@pytest.mark.parametrize(("state", "fan"), [("1\n", True), ("0\n", False), ("?\n", None)])
def test_the_kernels_fan_is_found_and_read(config: ThermometerConfig, state: str, fan: bool | None) -> None:
    for i, kind in enumerate(("cpufreq-cpu0", "gpio-fan")):
        folder = Path(config.cooling) / f"cooling_device{i}"
        folder.mkdir()
        (folder / "type").write_text(kind + "\n")
        (folder / "cur_state").write_text(state)
    assert CpuThermometer(config, ManualClock()).read(0.0).fan is fan


def test_throttling_is_named_and_logged_when_it_changes(
    config: ThermometerConfig, caplog: pytest.LogCaptureFixture
) -> None:
    thermometer = CpuThermometer(config, ManualClock())
    for bits in ("50005\n", "50005\n", "50000\n", "50000\n"):
        Path(config.throttled).write_text(bits)
        thermometer.read(0.0)
    assert [r.getMessage() for r in caplog.records] == [
        "processor: under-voltage, throttled",
        "processor: runs freely again",
    ]


def test_what_cannot_be_read_is_named(config: ThermometerConfig) -> None:
    thermometer = CpuThermometer(config, ManualClock())
    Path(config.zone).write_text("hot\n")
    with pytest.raises(DeviceError, match=r"thermometer at .*temp: cannot be read"):
        thermometer.read(0.0)
    Path(config.zone).unlink()
    with pytest.raises(DeviceError, match="No such file"):
        CpuThermometer(config, ManualClock())
    thermometer.close()
    with pytest.raises(DeviceError, match="closed"):
        thermometer.read(0.0)
