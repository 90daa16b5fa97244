#!/usr/bin/env bash
# Puts the plugins compose (v2) and buildx into the folder cli-plugins of $DOCKER_CONFIG, from Debian 13's packages: for
# distributions that have none of their own. They need libc 2.34 or newer.
set -euo pipefail
target=${DOCKER_CONFIG:-$HOME/.docker}/cli-plugins
keys=/usr/share/keyrings/debian-archive-keyring.gpg

fail() { echo "plugins.sh: $1" >&2; exit 1; }

[ -e "$keys" ] || fail "no $keys: install Docker's own packages docker-compose-plugin and docker-buildx-plugin"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work/lists/partial" "$work/archives/partial" "$target"
echo "deb [signed-by=$keys] http://deb.debian.org/debian trixie main" > "$work/sources.list"
# A separate apt configuration: that of this machine is not changed.
apt=(apt-get -q -q -o "Dir::Etc::sourcelist=$work/sources.list" -o Dir::Etc::sourceparts=- -o "Dir::State::lists=$work/lists"
    -o Dir::State::status=/dev/null -o "Dir::Cache=$work" -o APT::Sandbox::User= -o Acquire::Retries=3)
echo "plugins.sh: getting docker's plugins compose and buildx from Debian 13 ..." >&2
"${apt[@]}" update || fail "Debian's package lists cannot be fetched: see above"
(cd "$work" && "${apt[@]}" download docker-compose docker-buildx) || fail "the packages cannot be fetched: see above"
for package in "$work"/*.deb; do dpkg -x "$package" "$work/unpacked"; done
cp "$work"/unpacked/usr/libexec/docker/cli-plugins/* "$target"
