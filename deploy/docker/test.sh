#!/usr/bin/env bash
# `make docker-test`: builds the composition, flies it and takes it down again (tests/docker).
#
# It provides what is missing if it can: a running engine, compose v2 and buildx, the base image. Exit code 77: no engine, or
# something that it needs, is available; the reason is the last line.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
base=${BASE_IMAGE:-python:3.11-slim-bookworm}
project=radron-test-$$
work=$(mktemp -d)
engine=

finish() {
    # The test takes everything down itself, unless it is killed.
    (cd /; docker compose -p "$project" down --volumes --timeout 1) > /dev/null 2>&1 || true
    docker image rm "radron-agent:$project" "radron-sim:$project" > /dev/null 2>&1 || true
    if [ -n "$engine" ]; then
        kill "$engine" 2> /dev/null || true
        wait "$engine" 2> /dev/null || true
    fi
    rm -rf "$work"
}
trap finish EXIT
trap 'exit 143' TERM INT

no_engine() { echo "no docker engine: $1" >&2; exit 77; }

start_engine() {
    timeout 20 docker info > /dev/null 2>&1 && return
    [ "$(id -u)" = 0 ] || no_engine "none is running that this user may use, and only root can start one"
    command -v dockerd > /dev/null || no_engine "none is running, and dockerd is not installed (apt-get install docker.io)"
    echo "test.sh: starting an engine ..." >&2
    dockerd > "$work/dockerd.log" 2>&1 &
    engine=$!
    for _ in $(seq 60); do
        docker info > /dev/null 2>&1 && return
        kill -0 "$engine" 2> /dev/null || break
        sleep 0.5
    done
    no_engine "dockerd does not come up: $(tail -n 1 "$work/dockerd.log")"
}

command -v docker > /dev/null || no_engine "docker is not installed (apt-get install docker.io)"
start_engine

if ! docker compose version > /dev/null 2>&1 || ! docker buildx version > /dev/null 2>&1; then
    export DOCKER_CONFIG=${XDG_CACHE_HOME:-$HOME/.cache}/radron/docker
    docker compose version > /dev/null 2>&1 && docker buildx version > /dev/null 2>&1 || timeout 120 deploy/docker/plugins.sh \
        || no_engine "one is there, but not docker's plugins compose (v2) and buildx"
fi
if ! docker image inspect "$base" > /dev/null 2>&1; then
    timeout 60 docker pull --quiet "$base" 2> /dev/null || timeout 240 deploy/docker/base-image.sh "$base" \
        || no_engine "one is there, but no base image: neither a registry nor Debian's packages"
fi
# pip in the build trusts what pip on this machine is told to trust.
export PIP_CA_FILE=${PIP_CA_FILE:-${PIP_CERT:-/dev/null}}

DOCKER_TEST=$project .venv/bin/pytest tests/docker
