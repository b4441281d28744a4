"""A wire that carries bytes, and loses or garbles them: what a radio module hangs on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


@dataclass(slots=True)
class PortStatistics:
    """Counters since the port was opened."""

    written_bytes: int = 0
    read_bytes: int = 0


class BytePort(Protocol):
    """A serial port, one of the transceiver's two channels, or an emulated module: the driver cannot tell which.

    Opens in the constructor or raises `LinkError`. One thread at a time may read, another may write.
    """

    @property
    def name(self) -> str:
        """What the user calls it, for messages."""
        ...

    @property
    def statistics(self) -> PortStatistics: ...

    def write(self, data: bytes) -> None:
        """Hand over all of `data`. Raises `LinkError` when the port is closed, lost or takes nothing for too long."""
        ...

    def read(self, timeout_s: float) -> bytes:
        """What has arrived, as soon as anything has; empty when nothing came in time. Raises `LinkError`."""
        ...

    def set_baud_rate(self, baud_rate: int) -> bool:
        """Speak at another rate from now on; False where the rate is fixed. Raises `LinkError`."""
        ...

    def close(self) -> None:
        """Let go of the port; may be called twice."""
        ...
