#!/bin/sh
# Runs once, at the first start of a card that tools/flash has prepared, before the network is up: it makes a
# Raspberry Pi OS (64 bit) a robot. What it does is written to robot-first-boot.log beside it. Then the Pi starts again.
set -u

HERE=$(cd "$(dirname "$0")" && pwd)
CMDLINE=$HERE/cmdline.txt
SOURCE=/opt/robot-app/source
exec >>"$HERE/robot-first-boot.log" 2>&1
echo "== first start, $(date)"

# Whatever happens below, the next start is an ordinary one.
sed -i 's| systemd\.run=[^ ]*||g; s| systemd\.run_success_action=[^ ]*||g; s| systemd\.run_failure_action=[^ ]*||g; s| systemd\.unit=kernel-command-line.target||g' "$CMDLINE"

failed() {
    echo "FAILED: $*"
    status=1
}
status=0

mkdir -p "$SOURCE"
tar -xf "$HERE/robot-first-boot.tar" -C "$SOURCE" || failed "robot-first-boot.tar cannot be unpacked; write the card again"
(cd "$SOURCE" && sha256sum --quiet --check SHA256SUMS) || failed "files differ from what was written; the card may be bad"
. "$SOURCE/settings.sh" || failed "settings.sh cannot be read"

echo "== host $HOST, user $LOGIN"
echo "$HOST" >/etc/hostname
sed -i '/^127\.0\.1\.1/d' /etc/hosts
echo "127.0.1.1 $HOST" >>/etc/hosts
[ ! -e "/usr/share/zoneinfo/$TIME_ZONE" ] || ln -sf "/usr/share/zoneinfo/$TIME_ZONE" /etc/localtime
systemctl disable userconfig.service 2>/dev/null # the question for a user name at the screen
same_group=$(getent group "$LOGIN" >/dev/null && echo "--gid $LOGIN")
id "$LOGIN" >/dev/null 2>&1 || useradd --create-home --shell /bin/bash $same_group "$LOGIN" || failed "user $LOGIN cannot be made"
for group in sudo dialout gpio i2c video plugdev; do
    ! getent group "$group" >/dev/null || usermod --append --groups "$group" "$LOGIN"
done
if [ -n "$SSH_KEY" ]; then
    home=$(getent passwd "$LOGIN" | cut -d: -f6)
    install -d -m 0700 -o "$LOGIN" "$home/.ssh"
    printf '%s\n' "$SSH_KEY" >"$home/.ssh/authorized_keys"
    chown "$LOGIN" "$home/.ssh/authorized_keys"
    chmod 0600 "$home/.ssh/authorized_keys"
    mkdir -p /etc/sudoers.d
    printf '%s ALL=(ALL) NOPASSWD: ALL\n' "$LOGIN" >/etc/sudoers.d/robot-operator
    chmod 0440 /etc/sudoers.d/robot-operator
    mkdir -p /etc/ssh/sshd_config.d
    echo "PasswordAuthentication no" >/etc/ssh/sshd_config.d/robot.conf
    systemctl enable ssh.service 2>/dev/null || failed "there is no SSH server"
fi

if [ -n "$WIFI_SSID" ]; then
    echo "== Wi-Fi $WIFI_SSID"
    command -v raspi-config >/dev/null && raspi-config nonint do_wifi_country "$WIFI_COUNTRY"
    for file in /var/lib/systemd/rfkill/*:wlan; do [ ! -e "$file" ] || echo 0 >"$file"; done
    connection=/etc/NetworkManager/system-connections/robot.nmconnection
    mkdir -p "$(dirname "$connection")"
    (
        umask 077
        # NetworkManager takes a name as a list of bytes, which leaves no character to escape.
        ssid=$(printf '%s' "$WIFI_SSID" | od -An -v -tu1 | tr -s ' \n' ';' | sed 's/^;//')
        printf '[connection]\nid=robot\ntype=wifi\nautoconnect=true\n\n[wifi]\nmode=infrastructure\nssid=%s\npowersave=2\n\n' "$ssid"
        if [ -n "$WIFI_PASSWORD" ]; then
            printf '[wifi-security]\nkey-mgmt=wpa-psk\npsk=%s\n\n' "$(printf '%s' "$WIFI_PASSWORD" | sed 's/\\/\\\\/g; s/^ /\\s/')"
        fi
        printf '[ipv4]\nmethod=auto\n\n[ipv6]\nmethod=auto\n'
    ) >"$connection"
    chmod 0600 "$connection"
fi

echo "== app"
mkdir -p /etc/robot-app
[ ! -e "$SOURCE/robot.toml" ] || install -m 0644 "$SOURCE/robot.toml" /etc/robot-app/robot.toml
[ ! -e "$SOURCE/pairing.pem" ] || install -m 0600 "$SOURCE/pairing.pem" /etc/robot-app/pairing.pem
sh "$SOURCE/systemd/install.sh" --wheels "$SOURCE/wheels" --camera "$SOURCE/camera" --no-start || failed "the app could not be installed"

# The key and the Wi-Fi's password do not stay on a partition that every computer reads.
if [ "$status" = 0 ]; then
    rm -f "$HERE/robot-first-boot.tar" "$HERE/first-boot.sh" "$SOURCE/settings.sh" "$SOURCE/pairing.pem"
    rm -rf "$SOURCE/wheels" "$SOURCE/camera"
    echo "== done; the robot starts with the next start"
fi
sync
exit "$status"
