"""What makes one robot's card different from another's."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

_HOST = re.compile(r"[a-z0-9]([a-z0-9-]{0,61}[a-z0-9])?")
_USER = re.compile(r"[a-z_][a-z0-9_-]{0,30}")
_COUNTRY = re.compile(r"[A-Z]{2}")


@dataclass(frozen=True, slots=True)
class CardSettings:
    """Raises ValueError, in words, for what the Pi would refuse."""

    hostname: str = "robot"
    user: str = "operator"
    ssh_key: str = ""  # a public key; without one nobody can log in over the network
    wifi_ssid: str = ""
    wifi_password: str = ""
    wifi_country: str = ""
    time_zone: str = "Etc/UTC"
    pairing: Path | None = None
    robot_toml: Path | None = None

    def __post_init__(self) -> None:
        if not _HOST.fullmatch(self.hostname):
            raise ValueError(f"{self.hostname!r} is no host name: small letters, digits and hyphens")
        if not _USER.fullmatch(self.user) or self.user in ("root", "robot"):
            raise ValueError(f"{self.user!r} cannot be the user: small letters and digits, and not root or robot")
        if self.ssh_key and not re.match(r"(ssh-|ecdsa-|sk-)\S+ \S+", self.ssh_key):
            raise ValueError("the key is no public SSH key; take the file that ends in .pub")
        if self.wifi_ssid and not _COUNTRY.fullmatch(self.wifi_country):
            raise ValueError("Wi-Fi needs the country it is used in, as two capital letters, for example JP")
        if self.wifi_ssid and not 1 <= len(self.wifi_ssid.encode()) <= 32:
            raise ValueError("the name of a Wi-Fi network has 1 to 32 bytes")
        if self.wifi_password and not 8 <= len(self.wifi_password.encode()) <= 63:
            raise ValueError("the password of a Wi-Fi network has 8 to 63 bytes")
        if any(character in self.wifi_ssid + self.wifi_password + self.ssh_key for character in "\n\r\0"):
            raise ValueError("names, passwords and keys are one line each")
        if not re.fullmatch(r"[A-Za-z0-9_+-]+(/[A-Za-z0-9_+-]+)*", self.time_zone):
            raise ValueError(f"{self.time_zone!r} is no time zone; one is Asia/Tokyo")

    def as_shell(self) -> str:
        """Assignments that a shell reads, each value quoted."""
        values = {
            "HOST": self.hostname,
            "LOGIN": self.user,
            "SSH_KEY": self.ssh_key,
            "WIFI_SSID": self.wifi_ssid,
            "WIFI_PASSWORD": self.wifi_password,
            "WIFI_COUNTRY": self.wifi_country,
            "TIME_ZONE": self.time_zone,
        }
        return "".join(f"{name}={shlex.quote(value)}\n" for name, value in values.items())
