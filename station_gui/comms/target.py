"""Where the operator wants to connect to."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Target:
    """Wi-Fi where there is a host, LoRa where there are radio ports, or both."""

    host: str = ""
    port: int = 0
    radio_ports: tuple[str, ...] = ()

    def __str__(self) -> str:
        names = [f"{self.host}:{self.port}"] if self.host else []
        if self.radio_ports:
            names.append(f"LoRa at {' and '.join(self.radio_ports)}")
        return ", ".join(names)
