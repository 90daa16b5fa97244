#!/bin/sh
# In the image build: removes what is never run: pip, tests, type stubs, second builds of a library, headers, unused MAVLink dialects.
set -eu
cd /opt/radron/lib/python3*/site-packages

rm -rf pip pip-*.dist-info ../../../bin/pip* ../../../bin/[aA]ctivate*
find . -mindepth 2 -depth -type d \( -name tests -o -name include \) -exec rm -rf {} +
find . -type f \( -name '*.pyi' -o -name '*.pxd' -o -name '*.h' -o -name '*.a' -o -name '*.c' \) -delete
# Second builds of the same library: the array interface of xraylib, and zstandard for interpreters without C extensions.
rm -f xraylib_np.*.so zstandard/_cffi.*.so zstandard/backend_cffi.py
if [ -d pymavlink ]; then
    find pymavlink/dialects -type f \( -name '*.xml' -o -path '*/v1.0/*' -o -path '*/v10/*' \) ! -name __init__.py -delete
    find pymavlink/dialects/v20 -type f ! -name __init__.py ! -name common.py ! -name ardupilotmega.py -delete
fi
