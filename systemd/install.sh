#!/bin/sh
# Makes a Raspberry Pi OS or Debian (64 bit, Python 3.11 or newer) a robot: run it there as root, from a checkout.
#
#   sudo sh systemd/install.sh [--wheels DIR] [--camera DIR] [--no-start]
#
#   --wheels DIR   take the packages from here instead of from the network (tools/flash fetches them)
#   --camera DIR   the same of what camera-packages.txt lists
#   --no-start     only install: for an image, or when the robot must not start yet
#
# It can be run again at any time: it brings the app up to date and leaves /etc/robot-app as it is.
set -eu

HOME_DIR=/opt/robot-app
CONFIG_DIR=/etc/robot-app
SOURCE=$(cd "$(dirname "$0")/.." && pwd)
wheels=
camera=
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
    --camera)
        [ -d "${2:-}" ] || fail "--camera needs a folder, not '${2:-}'"
        camera=$(cd "$2" && pwd)
        shift
        ;;
    --no-start) start=no ;;
    *) fail "what is '$1'? Known are --wheels DIR, --camera DIR and --no-start" ;;
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

say "Python 3.9 for the L515, in $HOME_DIR/camera"
# librealsense 2.54.2 is the last that knows the L515, and its wheels for this processor end at Python 3.9. The process
# that reads the camera has this Python; nothing else uses it.
fetch_camera() {
    while read -r sum path; do
        case "$path" in
        pool/*)
            for mirror in https://deb.debian.org/debian https://archive.debian.org/debian; do
                "$venv" -c 'import sys, urllib.request; urllib.request.urlretrieve(*sys.argv[1:])' \
                    "$mirror/$path" "$1/$(basename "$path")" 2>/dev/null && break
            done
            ;;
        *)
            "$venv" -m pip --disable-pip-version-check --quiet download --no-deps --only-binary=:all: --python-version 3.9 \
                --platform manylinux2014_aarch64 --implementation cp --dest "$1" \
                "$(echo "$path" | cut -d- -f1)==$(echo "$path" | cut -d- -f2)" || return 1
            ;;
        esac
    done <"$SOURCE/systemd/camera-packages.txt"
}
install_camera() {
    sed 's|  .*/|  |' "$SOURCE/systemd/camera-packages.txt" | (cd "$1" && sha256sum --quiet --check -) || return 1
    new=$HOME_DIR/camera.new
    rm -rf "$new"
    mkdir -p "$new/usr/lib/python3/dist-packages"
    for package in "$1"/*.deb; do dpkg-deb -x "$package" "$new" || return 1; done
    "$venv" -m zipfile -e "$1"/pyrealsense2-*.whl "$new/usr/lib/python3/dist-packages" || return 1
    rm -rf "$new/usr/lib/python3/dist-packages"/*.data "$new/usr/share" "$new/etc"
    cat >"$new/python" <<'END'
#!/bin/sh
# Python 3.9 of Debian 11 with pyrealsense2, for devices.camera.interpreter.
here=$(dirname "$(readlink -f "$0")")
LD_LIBRARY_PATH=$here/usr/lib/aarch64-linux-gnu exec "$here/usr/bin/python3.9" "$@"
END
    chmod 0755 "$new/python"
    "$new/python" -c 'import pyrealsense2' || return 1
    rm -rf "$HOME_DIR/camera"
    mv "$new" "$HOME_DIR/camera"
}
if [ "$(uname -m)" = aarch64 ]; then
    fetched=$(mktemp -d)
    if [ -z "$camera" ] && [ -z "$wheels" ]; then fetch_camera "$fetched" && camera=$fetched; fi
    [ -n "$camera" ] && install_camera "$camera" ||
        echo "install.sh: the L515 cannot be read: its Python 3.9 is not installed; run this again, with a network" >&2
    rm -rf "$fetched"
fi

say "configuration, in $CONFIG_DIR"
mkdir -p "$CONFIG_DIR"
if [ ! -e "$CONFIG_DIR/robot.toml" ]; then
    install -m 0644 "$SOURCE/robot_app/robot.toml" "$CONFIG_DIR/robot.toml"
    [ ! -x "$HOME_DIR/camera/python" ] ||
        sed -i "s|^interpreter = \"\"|interpreter = \"$HOME_DIR/camera/python\"|" "$CONFIG_DIR/robot.toml"
fi
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
