"""`python -m tools.flash`: makes a card, or the image of one, from which a Raspberry Pi starts as a robot."""

from __future__ import annotations

import argparse
import getpass
import lzma
import os
import shutil
import sys
from pathlib import Path

from shared.command_line import EXIT_OK, Parser, Refused, existing_file, run
from shared.link.pairing import read_pairing
from tools.flash.fat import boot_partition
from tools.flash.package import Package, build, first_start
from tools.flash.settings import CardSettings

_CHUNK = 1 << 22


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="flash",
        description="Takes a Raspberry Pi OS (64 bit, Lite is enough) as Raspberry Pi offers it and adds what makes it "
        "a robot. The first start takes some minutes and needs no network.",
        epilog="example: make image BASE=2026-raspios-lite.img.xz WIFI=lab COUNTRY=JP KEY=~/.ssh/id_ed25519.pub",
    )
    where = parser.add_subparsers(dest="where", required=True, metavar="WHERE")
    image = where.add_parser("image", help="a copy of a Raspberry Pi OS image file")
    image.add_argument("base", type=existing_file, help="the image that was downloaded, .img or .img.xz")
    image.add_argument("--out", type=Path, default=Path("out/robot.img"), help="what to write (out/robot.img)")
    card = where.add_parser("card", help="a card that Raspberry Pi OS was written to")
    card.add_argument("folder", type=Path, help="where its boot partition is mounted, for example /media/you/bootfs")
    for one in (image, card):
        _add_settings(one)
    return parser


def _add_settings(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--hostname", default="robot", help="of the Pi (robot)")
    parser.add_argument("--user", default="operator", help="who may log in (operator)")
    parser.add_argument("--ssh-key", type=existing_file, metavar="FILE", help="public key to log in with")
    parser.add_argument("--wifi", default="", metavar="SSID", help="network to join; its password is asked for")
    parser.add_argument("--wifi-password-file", type=existing_file, metavar="FILE", help="read it from here instead")
    parser.add_argument("--country", default="", metavar="CC", help="where Wi-Fi is used, for example JP")
    parser.add_argument("--time-zone", default="Etc/UTC", help="for example Asia/Tokyo")
    parser.add_argument("--pairing", type=existing_file, metavar="FILE", help="file of `radio-config key new`")
    parser.add_argument("--config", type=existing_file, metavar="FILE", help="robot.toml instead of the default one")
    parser.add_argument("--wheels", type=Path, metavar="DIR", help="keep the fetched packages here for the next time")


def _settings(args: argparse.Namespace) -> CardSettings:
    password = ""
    if args.wifi_password_file:
        password = args.wifi_password_file.read_text(encoding="utf-8").strip("\r\n")
    elif args.wifi:
        password = _asked(f"password of {args.wifi} (empty for none): ")
    try:
        return CardSettings(
            hostname=args.hostname,
            user=args.user,
            ssh_key=args.ssh_key.read_text(encoding="utf-8").strip() if args.ssh_key else "",
            wifi_ssid=args.wifi,
            wifi_password=password,
            wifi_country=args.country,
            time_zone=args.time_zone,
            pairing=args.pairing,
            robot_toml=args.config,
        )
    except ValueError as error:
        raise Refused(str(error)) from error


def _asked(question: str) -> str:
    try:
        return getpass.getpass(question)
    except EOFError as error:
        raise Refused("nobody can be asked for the Wi-Fi's password: name a file, --wifi-password-file FILE") from error


def _onto_image(base: Path, out: Path, package: Package) -> None:
    out.parent.mkdir(parents=True, exist_ok=True)
    part = out.with_name(out.name + ".part")
    _say(f"copying {base}")
    with lzma.open(base) if base.suffix == ".xz" else base.open("rb") as source, part.open("wb") as target:
        shutil.copyfileobj(source, target, _CHUNK)
    boot = boot_partition(part)
    if not boot.has("cmdline.txt"):
        raise Refused(f"{base}: its boot partition has no cmdline.txt; is it a Raspberry Pi OS image?")
    cmdline = _first_start(boot.read("cmdline.txt"), str(base))
    for name, data in package.files().items():
        boot.write(name, data)
    boot.write("cmdline.txt", cmdline.encode())
    part.replace(out)
    _say(f"{out} is ready: write it to a card, for example with Raspberry Pi Imager, without its own settings")


def _onto_card(folder: Path, line: str, package: Package) -> None:
    needed, free = sum(map(len, package.files().values())), shutil.disk_usage(folder).free
    if needed > free + sum((folder / name).stat().st_size for name in package.files() if (folder / name).is_file()):
        raise Refused(f"{folder}: {free / 1e6:.0f} MB are free, and the package has {needed / 1e6:.0f} MB; make room")
    for name, data in package.files().items():
        (folder / name).write_bytes(data)
    (folder / "cmdline.txt").write_text(line, encoding="utf-8")
    os.sync()
    _say(f"{folder} is ready: eject the card and start the Pi from it")


def _card_line(folder: Path) -> str:
    """The card's command line for the first start, so that another folder is refused before anything is fetched."""
    cmdline = folder / "cmdline.txt"
    if not cmdline.is_file():
        raise Refused(f"{folder}: has no cmdline.txt; name the folder where the card's boot partition is mounted")
    return _first_start(cmdline.read_text(encoding="utf-8", errors="replace"), str(cmdline))


def _first_start(cmdline: str, where: str) -> str:
    try:
        return first_start(cmdline)
    except ValueError as error:
        raise Refused(f"{where}: {error}") from error


def _say(text: str) -> None:
    print(text, flush=True)


def _work(args: argparse.Namespace) -> int:
    settings = _settings(args)
    if settings.pairing is not None:
        read_pairing(settings.pairing)  # with another file the robot would not start
    if not settings.ssh_key:
        _say("no --ssh-key: nobody can log in over the network")
    if settings.pairing is None:
        _say("no --pairing: anybody on the network can command this robot")
    if args.where == "image":
        _onto_image(args.base, args.out, build(settings, args.wheels, _say))
    else:
        line = _card_line(args.folder)
        _onto_card(args.folder, line, build(settings, args.wheels, _say))
    return EXIT_OK


def main() -> int:
    args = _parser().parse_args()
    return run("flash", lambda: _work(args))


if __name__ == "__main__":
    sys.exit(main())
