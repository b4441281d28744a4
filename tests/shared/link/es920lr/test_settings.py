"""Settings: what the module has, what it shows, how one becomes another."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from shared.link.es920lr.settings import (
    ROWS,
    BootMode,
    Format,
    Node,
    RadioSettings,
    SettingsError,
    Sleep,
    Transfer,
    commands,
    conflicts,
    differences,
    parse_show,
)
from tools.simulator.devices.es920lr_console import shown

# A newer module, as its owner noted it.
NEWER = """
 -------------------------------------
 Node                        : EndDevice
 Band Width                  : 125kHz
 Spreading Factor            : 11
 Effective Bitrate           : 537bps
 Channel                     : 2
 PAN ID                      : 0001
 Own Node ID                 : 0001
 Destination ID              : 0000
 Acknowledge                 : OFF
 Retry count                 : 3
 Transfer Mode               : Payload
 Receive Node ID information : OFF
 RSSI information            : ON
 Config/Operation            : Operation
 UART baudrate               : 115200
 Sleep Mode                  : No Sleep
 Sleep Time                  : 50
 Output Power                : 13dBm
 Format                      : ASCII
 Send Time                   : 0
 Send Data                   :
 AES Key                     : 00000000000000000000000000000000
 RF Mode                     : TxRx
 Rx Boosted                  : ON
""".replace("\n", "\r\n")

CHANNELS = {62_500: 15, 125_000: 15, 250_000: 7, 500_000: 5}


@st.composite
def any_settings(draw: st.DrawFn) -> RadioSettings:
    bandwidth_hz = draw(st.sampled_from(sorted(CHANNELS)))
    return RadioSettings(
        node=draw(st.sampled_from(Node)),
        bandwidth_hz=bandwidth_hz,
        spreading_factor=draw(st.integers(7, 12)),
        channel=draw(st.integers(1, CHANNELS[bandwidth_hz])),
        pan_id=draw(st.integers(1, 0xFFFE)),
        own_id=draw(st.integers(0, 0xFFFE)),
        destination_id=draw(st.integers(0, 0xFFFF)),
        acknowledge=draw(st.booleans()),
        retries=draw(st.integers(0, 10)),
        transfer=draw(st.sampled_from(Transfer)),
        show_sender=draw(st.booleans()),
        show_rssi=draw(st.booleans()),
        boot_mode=draw(st.sampled_from(BootMode)),
        baud_rate=draw(st.sampled_from((9_600, 19_200, 38_400, 57_600, 115_200, 230_400))),
        sleep=draw(st.sampled_from(Sleep)),
        sleep_time_s=draw(st.integers(1, 864_000)) * 0.1,
        power_dbm=draw(st.integers(-4, 13)),
        format=draw(st.sampled_from(Format)),
        auto_send_interval_s=draw(st.integers(0, 86_400)),
        auto_send_text=draw(st.text("abc:XYZ 019-", max_size=50).map(str.strip)),
    )


@given(any_settings())
def test_what_is_shown_is_read_back(settings: RadioSettings) -> None:
    assert parse_show(shown(settings)).settings == settings


@given(any_settings(), any_settings())
def test_commands_make_one_setting_of_another(wanted: RadioSettings, current: RadioSettings) -> None:
    values = {row.field: getattr(current, row.field) for row in ROWS}
    by_command = {row.command: row for row in ROWS}
    for command in commands(wanted, current):
        name, _, value = command.text.partition(" ")
        if name == "bw" and values["channel"] > CHANNELS[by_command[name].from_command(value)]:
            values["channel"] = 1  # the module's own doing
        values[by_command[name].field] = by_command[name].from_command(value)
        RadioSettings(**values)  # possible at every step
    assert RadioSettings(**values) == wanted


def test_settings_of_a_newer_module_are_read_and_the_unknown_kept() -> None:
    read = parse_show(NEWER)
    assert read.settings == RadioSettings(
        spreading_factor=11, channel=2, acknowledge=False, show_rssi=True, boot_mode=BootMode.OPERATION
    )
    assert [label for label, _ in read.other] == ["AES Key", "RF Mode", "Rx Boosted"]


@pytest.mark.parametrize(
    ("line", "named"),
    [("Spreading Factor            : 11", "Spreading Factor"), ("Output Power                : 13dBm", "Output Power")],
)
def test_a_missing_or_strange_line_is_named(line: str, named: str) -> None:
    for text in (NEWER.replace(line, ""), NEWER.replace(line, line.partition(":")[0] + ": ???")):
        with pytest.raises(SettingsError, match=named):
            parse_show(text)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"bandwidth_hz": 100_000}, "bandwidth_hz is one of 62500, 125000"),
        ({"spreading_factor": 6}, "spreading_factor is 7 to 12, not 6"),
        ({"spreading_factor": 13}, "spreading_factor is 7 to 12, not 13"),
        ({"channel": 16}, "channel is 1 to 15 at 125 kHz"),
        ({"channel": 6, "bandwidth_hz": 500_000}, "channel is 1 to 5 at 500 kHz"),
        ({"channel": 0}, "channel is 1 to 15"),
        ({"pan_id": 0}, "pan_id is 0x0001 to 0xfffe"),
        ({"pan_id": 0xFFFF}, "pan_id is 0x0001 to 0xfffe"),
        ({"own_id": 0xFFFF}, "own_id is 0x0000 to 0xfffe"),
        ({"destination_id": 0x10000}, "destination_id"),
        ({"retries": 11}, "retries is 0 to 10"),
        ({"baud_rate": 4_800}, "baud_rate is one of"),
        ({"power_dbm": 14}, "power_dbm is -4 to 13, not 14"),
        ({"power_dbm": -5}, "power_dbm is -4 to 13, not -5"),
        ({"sleep_time_s": 0.0}, "sleep_time_s"),
        ({"auto_send_interval_s": 86_401}, "auto_send_interval_s is 0 to 86400"),
        ({"auto_send_text": "x" * 51}, "auto_send_text"),
        ({"auto_send_text": "a\r\nsave"}, "auto_send_text"),
    ],
)
def test_values_that_the_module_does_not_have_are_refused(change: dict[str, Any], told: str) -> None:
    with pytest.raises(SettingsError, match=told):
        RadioSettings(**change)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"node": Node.COORDINATOR, "sleep": Sleep.TIMER}, "end_device"),
        ({"auto_send_interval_s": 5}, "nothing to send"),
        ({"destination_id": 1}, "talk to itself"),
        ({"destination_id": 0xFFFF}, "nobody acknowledges"),
    ],
)
def test_combinations_that_cannot_be_meant_are_told(change: dict[str, Any], told: str) -> None:
    assert told in conflicts(dataclasses.replace(RadioSettings(), **change))[0]
    assert conflicts(RadioSettings()) == []


def test_frequencies_are_those_of_the_firmware() -> None:
    assert RadioSettings(channel=15).frequency_hz == 923_400_000
    assert RadioSettings(bandwidth_hz=250_000, channel=7).frequency_hz == 923_100_000
    assert RadioSettings(bandwidth_hz=500_000, channel=5).frequency_hz == 923_200_000


def test_only_what_differs_is_set_and_the_baud_rate_last() -> None:
    wanted = RadioSettings(baud_rate=230_400, format=Format.BINARY, spreading_factor=9)
    assert [c.text for c in commands(wanted, RadioSettings())] == ["sf 9", "format 2", "baudrate 6"]
    assert commands(wanted, wanted) == ()
    assert len(commands(wanted)) == len(ROWS)
    assert commands(wanted)[-1].new_baud_rate == 230_400


def test_differences_name_field_and_both_values() -> None:
    assert differences(RadioSettings(channel=3), RadioSettings()) == (("channel", 1, 3),)
