"""The pairing file: what robot and station know and nobody else does.

One PEM file, the same on both sides, written once by `radio-config key new` or `robot-app --new-pairing`: a private key
and its own certificate. TLS takes both as they are: each side shows the certificate and trusts no other. The key of the
radios is derived from the private key. Validity dates are not looked at: a Raspberry Pi without a network does not know
what day it is.
"""

from __future__ import annotations

import hashlib
import os
import re
import ssl
import stat
import subprocess
from dataclasses import dataclass
from pathlib import Path

from shared.link.base import LinkError

_CERTIFICATE = re.compile(r"-----BEGIN CERTIFICATE-----.+?-----END CERTIFICATE-----\n?", re.DOTALL)
_PRIVATE_KEY = re.compile(r"-----BEGIN PRIVATE KEY-----(.+?)-----END PRIVATE KEY-----", re.DOTALL)
_NO_CHECK_TIME = ssl.VerifyFlags(0x200000)  # X509_V_FLAG_NO_CHECK_TIME, which the module does not name
_MOST_BYTES = 65_536
_OPENSSL = (
    "openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
    "-days", "36500", "-subj", "/CN=low-bandwidth-mapper", "-keyout", "-", "-out", "-",
)  # fmt: skip
_OPENSSL_TIMEOUT_S = 30.0


class PairingError(LinkError):
    """The two sides cannot trust each other as their files are: somebody has to mend one."""


@dataclass(frozen=True, slots=True, repr=False)
class Pairing:
    """What `read_pairing` found. Its `repr` shows nothing of it."""

    path: Path
    certificate: str
    radio_key: bytes  # 32 bytes

    @property
    def fingerprint(self) -> str:
        """The same on both sides when the files are; tells nothing of the key."""
        digest = hashlib.sha256(ssl.PEM_cert_to_DER_cert(self.certificate)).hexdigest()[:16]
        return ":".join(digest[i : i + 4] for i in range(0, 16, 4))

    def tls_context(self, server_side: bool) -> ssl.SSLContext:
        """TLS 1.3, and nobody but who has the file. Raises `PairingError` where its parts do not fit."""
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER if server_side else ssl.PROTOCOL_TLS_CLIENT)
        context.minimum_version = ssl.TLSVersion.TLSv1_3
        context.check_hostname = False  # who has the key is who it is, at whatever address
        context.verify_mode = ssl.CERT_REQUIRED
        context.verify_flags |= _NO_CHECK_TIME
        if server_side:
            context.num_tickets = 0
        try:
            context.load_cert_chain(self.path)
            context.load_verify_locations(cadata=self.certificate)
        except (OSError, ValueError) as error:
            remedy = "make a new one with `radio-config key new` and copy it to the other side"
            raise PairingError(f"{self.path}: is damaged ({error}); {remedy}") from error
        return context


def read_pairing(path: Path) -> Pairing:
    """Raises `PairingError`, which says what to do."""
    try:
        mode = path.stat().st_mode
        text = path.read_bytes()[:_MOST_BYTES].decode("ascii", "replace")
    except OSError as error:
        remedy = "make one with `radio-config key new` and copy it to the other side"
        raise PairingError(f"{path}: no pairing file ({error.strerror}); {remedy}") from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise PairingError(f"{path}: others may read it; run `chmod 600 {path}`")
    certificate, private_key = _CERTIFICATE.search(text), _PRIVATE_KEY.search(text)
    if certificate is None or private_key is None:
        raise PairingError(f"{path}: is no pairing file; make one with `radio-config key new`")
    secret = "".join(private_key[1].split()).encode()
    pairing = Pairing(path, certificate[0], hashlib.blake2s(secret, person=b"radio").digest())
    pairing.tls_context(server_side=False)  # LoRa alone must not go by a key that is none
    return pairing


def write_new_pairing(path: Path) -> None:
    """A fresh key, readable by its owner alone. Raises `LinkError` without openssl, `OSError` for a bad place."""
    try:
        made = subprocess.run(_OPENSSL, capture_output=True, check=True, timeout=_OPENSSL_TIMEOUT_S).stdout
    except FileNotFoundError as error:
        raise LinkError("there is no openssl program to make the key with; `sudo apt install openssl`") from error
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
        raise LinkError(f"openssl makes no key: {error}") from error
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f"{path.name}.new")
    unfinished.unlink(missing_ok=True)
    with os.fdopen(os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(made)
        file.flush()
        os.fsync(file.fileno())
    unfinished.replace(path)
