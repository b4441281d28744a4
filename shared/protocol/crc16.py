"""CRC-16/MCRF4XX: polynomial 0x1021 reflected, from 0xFFFF; every error burst of up to 16 bits is found."""

from __future__ import annotations


def _row(byte: int) -> int:
    for _ in range(8):
        byte = byte >> 1 ^ (0x8408 if byte & 1 else 0)
    return byte


_TABLE = tuple(_row(byte) for byte in range(256))


def crc16(data: bytes) -> int:
    """Of "123456789" it is 0x6F91; of data with its own CRC behind it, low byte first, it is 0."""
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ _TABLE[(crc ^ byte) & 0xFF]
    return crc
