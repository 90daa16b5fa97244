#!/usr/bin/env bash
# Makes the base image, Debian 12 with Python 3.11, from Debian's packages: for machines without access to a container registry.
#   deploy/docker/base-image.sh [TAG]     TAG is what ARG BASE_IMAGE of deploy/Dockerfile names, its default by default
set -euo pipefail
tag=${1:-python:3.11-slim-bookworm}

fail() { echo "base-image.sh: $1" >&2; exit 1; }

command -v mmdebstrap > /dev/null || {
    [ "$(id -u)" = 0 ] && apt-get install -y -q mmdebstrap > /dev/null 2>&1 || fail "mmdebstrap is missing: apt-get install mmdebstrap"
}
archive=$(mktemp)
trap 'rm -f "$archive"' EXIT
echo "base-image.sh: no registry needed: making $tag from Debian's packages (about a minute) ..." >&2
mmdebstrap --quiet --variant=minbase --include=python3,python3-venv,ca-certificates --format=tar \
    --dpkgopt='path-exclude=/usr/share/doc/*' --dpkgopt='path-exclude=/usr/share/man/*' \
    --dpkgopt='path-exclude=/usr/share/locale/*' --aptopt='Acquire::Retries "3"' bookworm "$archive" \
    || fail "Debian's packages cannot be fetched: see above"
docker import --change 'CMD ["python3"]' --change 'ENV LANG=C.UTF-8' "$archive" "$tag" > /dev/null
