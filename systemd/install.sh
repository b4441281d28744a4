#!/bin/sh
# Makes a Raspberry Pi OS or Debian (64 bit, Python 3.11 or newer) a robot: run it there as root, from a checkout.
#
#   sudo sh systemd/install.sh [--wheels DIR] [--no-start]
#
#   --wheels DIR   take the packages from here instead of from the network (tools/flash fetches them)
#   --no-start     only install: for an image, or when the robot must not start yet
#
# It can be run again at any time: it brings the app up to date and leaves /etc/robot-app as it is.
set -eu

HOME_DIR=/opt/robot-app
CONFIG_DIR=/etc/robot-app
SOURCE=$(cd "$(dirname "$0")/.." && pwd)
wheels=
start=yes

fail() {
    echo "install.sh: $*" >&2
    exit 1
}

while [ $# -gt 0 ]; do
    case "$1" in
    --wheels)
        [ -d "${2:-}" ] || fail "--wheels needs a folder, not '${2:-}'"
        wheels=$(cd "$2" && pwd)
        shift
        ;;
    --no-start) start=no ;;
    *) fail "what is '$1'? Known are --wheels DIR and --no-start" ;;
    esac
    shift
done

[ "$(id -u)" = 0 ] || fail "run it as root: sudo sh systemd/install.sh"
python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' || fail "Python 3.11 or newer is needed; take a newer system"
[ "$(uname -m)" = aarch64 ] || echo "install.sh: this is no 64 bit Raspberry Pi; going on all the same" >&2

say() { echo "== $*"; }

say "user, groups, device rules"
install -D -m 0644 "$SOURCE/systemd/sysusers.conf" /etc/sysusers.d/robot.conf
systemd-sysusers /etc/sysusers.d/robot.conf
install -D -m 0644 "$SOURCE/systemd/60-robot.rules" /etc/udev/rules.d/60-robot.rules
install -D -m 0644 "$SOURCE/systemd/watchdog.conf" /etc/systemd/system.conf.d/robot.conf
install -D -m 0644 "$SOURCE/systemd/sysctl.conf" /etc/sysctl.d/60-robot.conf
install -D -m 0644 "$SOURCE/systemd/timesyncd.conf" /etc/systemd/timesyncd.conf.d/robot.conf
echo i2c-dev >/etc/modules-load.d/robot.conf

say "app, into $HOME_DIR"
mkdir -p "$HOME_DIR/docs"
venv=$HOME_DIR/venv/bin/python
pip() { "$venv" -m pip --disable-pip-version-check --no-input install --quiet "$@"; }
if [ -n "$wheels" ]; then
    # Debian keeps ensurepip in a package of its own, which is not needed so.
    [ -x "$venv" ] || python3 -m venv --without-pip "$HOME_DIR/venv"
    "$venv" "$(ls "$wheels"/pip-*.whl | tail -n 1)/pip" install --quiet --no-index --find-links "$wheels" --upgrade pip
    pip --no-index --find-links "$wheels" -r "$SOURCE/requirements/robot.lock"
    pip --no-index --no-deps --force-reinstall "$wheels"/low_bandwidth_mapper-*.whl
else
    if ! python3 -c 'import ensurepip' 2>/dev/null; then
        apt-get update -q && DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends python3-venv
    fi
    [ -x "$venv" ] || python3 -m venv "$HOME_DIR/venv"
    pip --require-hashes -r "$SOURCE/requirements/robot.lock"
    pip --no-deps --force-reinstall "$SOURCE"
fi
install -m 0755 "$SOURCE/systemd/motors-off.sh" "$HOME_DIR/motors-off"
install -m 0644 "$SOURCE/docs/robot.md" "$HOME_DIR/docs/robot.md"

say "configuration, in $CONFIG_DIR"
mkdir -p "$CONFIG_DIR"
[ -e "$CONFIG_DIR/robot.toml" ] || install -m 0644 "$SOURCE/robot_app/robot.toml" "$CONFIG_DIR/robot.toml"
[ ! -e "$CONFIG_DIR/pairing.pem" ] || { chown robot "$CONFIG_DIR/pairing.pem" && chmod 0600 "$CONFIG_DIR/pairing.pem"; }
for boot in /boot/firmware /boot; do
    [ -e "$boot/config.txt" ] || continue
    install -m 0644 "$SOURCE/systemd/robot-boot.txt" "$boot/robot-boot.txt"
    grep -q '^include robot-boot.txt' "$boot/config.txt" || printf '\n[all]\ninclude robot-boot.txt\n' >>"$boot/config.txt"
    break
done

say "service"
install -D -m 0644 "$SOURCE/systemd/robot-app.service" /etc/systemd/system/robot-app.service
systemctl enable --quiet robot-app.service
if [ "$start" = yes ]; then
    systemctl daemon-reload
    udevadm control --reload && udevadm trigger
    systemctl restart --no-block robot-app.service
    echo "Started; the first time it compiles for some minutes: journalctl -fu robot-app"
    echo "Restart the Pi once, for PWM, I2C and the watchdog."
fi
say "done"
