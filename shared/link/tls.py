"""TLS as bytes in, bytes out: Python's `ssl` (OpenSSL) without a socket of its own."""

from __future__ import annotations

import ssl

from shared.link.base import LinkError
from shared.link.pairing import PairingError

_READ_BYTES = 16_384  # a TLS record


class TlsStream:
    """One connection."""

    def __init__(self, context: ssl.SSLContext, server_side: bool, name: str) -> None:
        self.ready = False
        self._name = name
        self._incoming = ssl.MemoryBIO()
        self._outgoing = ssl.MemoryBIO()
        self._tls = context.wrap_bio(self._incoming, self._outgoing, server_side)
        self._shake_hands()

    def feed(self, data: bytes) -> bytes:
        """What the other side's bytes say. Raises `LinkError` when they are a stranger's."""
        self._incoming.write(data)
        if not self.ready:
            self._shake_hands()
        said = bytearray()
        while self.ready and (plain := self._read()):
            said += plain
        return bytes(said)

    def encrypt(self, data: bytes) -> None:
        """Put it into the output."""
        try:
            self._tls.write(data)
        except ssl.SSLError as error:
            raise self._refused(error) from error

    def take_output(self) -> bytes:
        """What is to be sent to the other side."""
        return self._outgoing.read()

    def _shake_hands(self) -> None:
        try:
            self._tls.do_handshake()
        except ssl.SSLWantReadError:
            return
        except ssl.SSLError as error:
            raise self._refused(error) from error
        self.ready = True

    def _read(self) -> bytes:
        try:
            return self._tls.read(_READ_BYTES)
        except ssl.SSLWantReadError:
            return b""
        except ssl.SSLError as error:
            raise self._refused(error) from error

    def _refused(self, error: ssl.SSLError) -> LinkError:
        reason = error.reason or ""
        if self.ready:
            return LinkError(f"{self._name}: the secure connection broke")
        if "CERTIFICATE" in reason or "ALERT" in reason:
            has = "has another pairing file: both sides need the same pairing file (`radio-config key show`)"
        else:
            has = "speaks without a pairing file, and here one is in use: give both sides the same pairing file"
        return PairingError(f"{self._name}: pairing: the other side {has}")
