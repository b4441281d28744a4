"""Write the C header of the transceiver's firmware from the tables of `shared/protocol/transceiver.py`.

`python -m tools.gen_protocol` writes it, `--check` only says whether the one that is there is up to date.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator
from enum import IntEnum
from pathlib import Path

from shared.protocol import transceiver as t

HEADER = Path(__file__).resolve().parents[1] / "arduino" / "transceiver" / "core" / "protocol_gen.h"
_C_TYPES = {"B": "uint8_t", "H": "uint16_t", "I": "uint32_t"}
_CONSTANTS = (
    "USB_BAUD",
    "DEFAULT_RADIO_BAUD",
    "RADIOS",
    "MAX_DATA_BYTES",
    "MAX_BODY_BYTES",
    "RADIO_TO_HOST_BYTES",
    "HOST_TO_RADIO_BYTES",
    "WINDOW_BYTES",
    "ANNOUNCE_EVERY_MS",
    "SESSION_TIMEOUT_MS",
    "RETRY_AFTER_MS",
    "MAX_RESET_MS",
)


def _snake(name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()


def _constants() -> Iterator[str]:
    yield f"#define PROTOCOL_FINGERPRINT 0x{t.FINGERPRINT:04X}u"
    yield f"#define FIRMWARE_MAJOR {t.VERSION[0]}u"
    yield f"#define FIRMWARE_MINOR {t.VERSION[1]}u"
    for name in _CONSTANTS:
        value = getattr(t, name)
        yield f"#define {name} {value}{'ul' if value > 0xFFFF else 'u'}"
    rates = " ".join(f"RATE({baud}ul)" for baud in t.RADIO_BAUDS)
    yield f"#define FOR_EACH_RADIO_BAUD(RATE) {rates}"


def _enum(kind: type[IntEnum]) -> Iterator[str]:
    prefix = _snake(kind.__name__).upper()
    yield f"enum {_snake(kind.__name__)} {{"
    for member in kind:
        yield f"    {prefix}_{member.name} = {member.value},"
    yield f"    {prefix}_COUNT = {len(kind)},"
    yield "};"


def _struct(layout: t.Layout) -> Iterator[str]:
    name = _snake(layout.kind.__name__)
    if layout.codes:
        yield f"struct __attribute__((packed)) {name} {{"
        yield from (f"    {_C_TYPES[code]} {field};" for field, code in layout.codes)
        yield "};"
        yield f'_Static_assert(sizeof(struct {name}) == {layout.size}, "{name} is packed");'


def header() -> str:
    """The whole text of the header."""
    lines = [
        "// Written by tools/gen_protocol.py from shared/protocol/transceiver.py; change that and run `make firmware`.",
        "#pragma once",
        "",
        "#include <stdint.h>",
        "",
        '_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "numbers lie in memory as on the wire");',
        "",
        *_constants(),
        "",
        "enum frame_number {",
        *(f"    FRAME_{_snake(layout.kind.__name__).upper()} = 0x{n:02X}," for n, layout in t.LAYOUTS.items()),
        "};",
    ]
    for kind in (t.ResetCause, t.Task, t.Port, t.Fault, t.Result):
        lines += ["", *_enum(kind)]
    for layout in t.LAYOUTS.values():
        if block := list(_struct(layout)):
            lines += ["", *block]
    return "\n".join(lines) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(prog="gen_protocol", description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing; exit 1 when the header is stale")
    arguments = parser.parse_args()
    text = header()
    fresh = HEADER.is_file() and HEADER.read_text("utf-8") == text
    if arguments.check and not fresh:
        print(f"gen_protocol: {HEADER} is stale; run: python -m tools.gen_protocol")
        return 1
    if not fresh:
        HEADER.write_text(text, "utf-8")
        print(f"gen_protocol: wrote {HEADER}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
