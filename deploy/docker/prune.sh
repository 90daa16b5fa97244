#!/bin/sh
# In the image build: removes what is never run: pip, setuptools, tests, type stubs, second builds of a library, headers,
# unused MAVLink dialects, fonts for PDF.
set -eu
cd /opt/radron/lib/python3*/site-packages

rm -rf pip pip-*.dist-info ../../../bin/pip* ../../../bin/[aA]ctivate*
rm -rf setuptools setuptools-*.dist-info pkg_resources _distutils_hack distutils-precedence.pth
find . -mindepth 2 -depth -type d \( -name tests -o -name include \) -exec rm -rf {} +
find . -type f \( -name '*.pyi' -o -name '*.pxd' -o -name '*.h' -o -name '*.a' -o -name '*.c' \) -delete
# Second builds of the same library: the array interface of xraylib, and zstandard for interpreters without C extensions.
rm -f xraylib_np.*.so zstandard/_cffi.*.so zstandard/backend_cffi.py
if [ -d pymavlink ]; then
    find pymavlink/dialects -type f \( -name '*.xml' -o -path '*/v1.0/*' -o -path '*/v10/*' \) ! -name __init__.py -delete
    find pymavlink/dialects/v20 -type f ! -name __init__.py ! -name common.py ! -name ardupilotmega.py -delete
fi
# matplotlib reads the names of glyphs; it would use the rest for files in PDF and PostScript, which nothing here writes.
if [ -d fontTools ]; then
    find fontTools -mindepth 1 -maxdepth 1 ! -name __init__.py ! -name agl.py ! -name misc -exec rm -rf {} +
fi
