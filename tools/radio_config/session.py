"""One module under configuration, on a serial port or behind the transceiver."""

from __future__ import annotations

import contextlib
import dataclasses
import sys
from collections.abc import Callable, Iterator
from typing import TypeVar

from shared.command_line import Refused
from shared.link.base import LinkError
from shared.link.byte_port import BytePort
from shared.link.es920lr.dialogue import Procedure
from shared.link.es920lr.driver import Es920lr, converse
from shared.link.es920lr.procedures import (
    BOOT_S,
    Mode,
    enter_configuration,
    load_defaults,
    read_settings,
    save,
    start,
    version,
    write_settings,
)
from shared.link.es920lr.settings import BootMode, RadioSettings
from shared.link.serial_port import SerialPort
from shared.link.transceiver import Transceiver
from shared.runtime.clock import Clock

T = TypeVar("T")
_RADIOS = {"A": 0, "B": 1}


class Module:
    """In configuration from its opening to `close`, which leaves it doing what it did before."""

    def __init__(
        self,
        port: BytePort,
        clock: Clock,
        baud_rate: int,
        reset: Callable[[], None],
        patience_s: float | None,
    ) -> None:
        """`patience_s`: how long the user may take who is asked by `reset`; None when it is the pin itself."""
        self.port = port
        self._clock = clock
        self._reset = reset
        self._has_pin = patience_s is None
        self._boot_s = BOOT_S if patience_s is None else patience_s
        self._operates = False
        found = self._run(enter_configuration(baud_rate, self._boot_s))
        self._was_operating = found.mode in {Mode.BINARY, Mode.ASCII}
        self.version = self._run(version())
        self.shown = self._run(read_settings())
        if self._was_operating:
            self._restore_boot_mode()

    @property
    def name(self) -> str:
        return self.port.name

    @property
    def settings(self) -> RadioSettings:
        return self.shown.settings

    def _restore_boot_mode(self) -> None:
        """To ask the module, its boot mode had to be changed in its flash memory."""
        self.set(dataclasses.replace(self.settings, boot_mode=BootMode.OPERATION))
        self.save()

    def set(self, wanted: RadioSettings) -> None:
        """In memory. What the module then shows is compared with what was wanted."""
        old_rate = self.settings.baud_rate
        if wanted.baud_rate != old_rate:
            if not self.port.set_baud_rate(wanted.baud_rate):
                raise Refused(f"{self.name}: this port has no {wanted.baud_rate} baud")
            self.port.set_baud_rate(old_rate)
        self._run(write_settings(wanted, self.settings))
        self.shown = self._run(read_settings())
        if self.settings != wanted:
            raise LinkError(f"{self.name}: the module has not taken all settings; show it and set them again")

    def save(self) -> None:
        self._run(save())

    def load_defaults(self) -> None:
        self._run(load_defaults())
        self.shown = self._run(read_settings())

    def configure_again(self) -> None:
        """After `operate`: reset it once more. Its flash memory then holds what it operated with."""
        self._run(enter_configuration(self.settings.baud_rate, self._boot_s))
        self._operates = False
        self.shown = self._run(read_settings())

    def close(self) -> None:
        """A module that was operating goes on, with what is set now."""
        try:
            if self._operates and self._has_pin:
                self._reset()  # what is saved holds again
            elif self._operates:
                say(f"{self.name}: holds the settings of the test until you switch its power off and on")
            elif self._was_operating:
                self._run(start())
        finally:
            self.port.close()

    def operate(self, settings: RadioSettings) -> Es920lr:
        """Start it with other settings, in memory; the driver has the port from now on."""
        self.set(settings)
        self._run(start())
        self._operates = True
        return Es920lr(self.port, settings, self._clock)

    def _run(self, procedure: Procedure[T]) -> T:
        return converse(self.port, procedure, self._clock, self._reset)


class Bench:
    """Opens ports by their names: `/dev/ttyUSB0`, or `/dev/ttyACM0:A` and `:B` for the radios of a transceiver."""

    def __init__(self, clock: Clock, baud_rate: int, patience_s: float) -> None:
        self.clock = clock
        self._baud_rate = baud_rate
        self._patience_s = patience_s
        self._transceivers: dict[str, Transceiver] = {}

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *_: object) -> None:
        for transceiver in self._transceivers.values():
            transceiver.close()

    @contextlib.contextmanager
    def module(self, name: str) -> Iterator[Module]:
        module = self.open(name)
        try:
            yield module
        finally:
            module.close()

    def open(self, name: str) -> Module:
        """Raises `LinkError`, which names the port."""
        path, colon, letter = name.rpartition(":")
        if colon and letter in _RADIOS:
            return self._behind_transceiver(path, _RADIOS[letter])
        if colon and len(letter) == 1 and letter.isalpha():
            raise Refused(f"{name}: a transceiver has two radios, {path}:A and {path}:B")
        port = SerialPort(name, self._baud_rate)
        with contextlib.ExitStack() as guard:
            guard.callback(port.close)
            module = Module(port, self.clock, self._baud_rate, lambda: self._ask_user(name), self._patience_s)
            guard.pop_all()
        return module

    def _behind_transceiver(self, path: str, radio: int) -> Module:
        if path not in self._transceivers:
            self._transceivers[path] = Transceiver(path, self.clock)
        port = self._transceivers[path].radios[radio]
        return Module(port, self.clock, self._baud_rate, port.reset, None)

    def _ask_user(self, name: str) -> None:
        say(f"{name}: the module is operating. Switch its power off and on now (waiting {self._patience_s:g} s) ...")


def say(text: str) -> None:
    """Progress and questions, beside the results."""
    print(text, file=sys.stderr, flush=True)
