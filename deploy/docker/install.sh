#!/bin/sh
# In the image build: pip install with the given arguments, as pinned in constraints.txt, into the environment /opt/radron.
set -eu

# Behind a TLS-inspecting egress the build is given its certificates as the secret `pipca`; elsewhere that is empty.
if [ -s /run/secrets/pipca ]; then export PIP_CERT=/run/secrets/pipca; fi
export PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_CACHE_DIR=1 PIP_NO_COMPILE=1 PIP_QUIET=1 PIP_CONSTRAINT=/source/constraints.txt

if [ ! -d /opt/radron ]; then
    python3 -m venv /opt/radron
    /opt/radron/bin/pip install setuptools
fi
/opt/radron/bin/pip install --no-build-isolation "$@"
