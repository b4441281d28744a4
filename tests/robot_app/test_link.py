"""The robot's end of each kind of link, on ports that are there and on ports that are not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from robot_app.config import LinkConfig, RobotConfig, load_config
from robot_app.link import open_link
from shared.link.base import LinkError, LinkPath
from shared.link.pairing import write_new_pairing
from shared.link.radio_config import RadioConfig
from shared.runtime.clock import MonotonicClock


@pytest.fixture(scope="module")
def pairing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("keys") / "pairing.pem"
    write_new_pairing(path)
    return path


def config(use: str, pairing: str = "", ports: tuple[str, ...] = ()) -> RobotConfig:
    link = LinkConfig(use, 0, "127.0.0.1", pairing)  # type: ignore[arg-type]
    return replace(load_config(None), link=link, radio=RadioConfig(ports))


def test_wifi_alone_listens_and_says_where() -> None:
    opened = open_link(config("tcp"), MonotonicClock())
    assert opened.where == f"127.0.0.1:{opened.port}"
    assert opened.link.health.lora is None
    assert not opened.link.mends_itself
    opened.link.close()


def test_a_robot_that_anybody_may_drive_says_so(caplog: pytest.LogCaptureFixture) -> None:
    open_link(config("tcp"), MonotonicClock()).link.close()
    assert not caplog.records
    everywhere = replace(config("tcp"), link=LinkConfig("tcp", 0))
    open_link(everywhere, MonotonicClock()).link.close()
    (record,) = caplog.records
    assert record.levelname == "WARNING"
    assert "link.pairing is empty" in record.getMessage()


def test_a_missing_pairing_file_is_named_with_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match=r"pairing\.pem: no pairing file"):
        open_link(config("radio", str(tmp_path / "pairing.pem"), ("/dev/none",)), MonotonicClock())


@pytest.mark.parametrize("use", ["radio", "both"])
def test_radios_that_are_not_there_keep_nothing_from_starting_and_are_named(use: str, pairing: Path) -> None:
    ports = ("/dev/no-such-port", "/dev/no-mega:A")
    opened = open_link(config(use, str(pairing), ports), MonotonicClock())
    clock, until_s = MonotonicClock(), 5.0
    while not all(radio.fault for radio in opened.link.health.radios) and clock.now_s() < until_s:
        assert opened.link.receive(0.01) is None
    faults = [radio.fault for radio in opened.link.health.radios]
    assert ["no such port" in fault for fault in faults] == [True, True]
    assert [port.split(":")[0] in fault for port, fault in zip(ports, faults, strict=True)] == [True, True]
    assert opened.link.mends_itself
    assert opened.link.path is LinkPath.RADIO
    assert opened.link.health.is_secret
    assert (opened.port is None) == (use == "radio")
    assert not opened.link.send(b"x")
    opened.link.close()
    with pytest.raises(LinkError):
        opened.link.receive(0.0)
