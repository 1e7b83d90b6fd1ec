#!/bin/sh
# Report what this machine lacks to build and run the project: one line for each missing item, exit status 2.
#
# usage: preflight.sh [PYTHON]     PYTHON is the interpreter that .venv is made from, python3 by default
# The C compiler is $CC where that is set, else the first of cc, gcc and clang.

python=${1:-python3}
status=0

missing() {
    echo "$1" >&2
    status=2
}

if ! command -v "$python" >/dev/null 2>&1; then
    missing "$python is missing: install Python 3.11 or newer (Debian, Ubuntu: apt install python3 python3-venv)"
elif ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
    missing "$python is older than 3.11: install Python 3.11 or newer and name it, e.g. make sil PYTHON=python3.12"
elif ! "$python" -c 'import venv, ensurepip' 2>/dev/null; then
    missing "$python has no venv: install it (Debian, Ubuntu: apt install python3-venv; elsewhere it comes with Python)"
fi

[ -w . ] || missing "$(pwd) cannot be written: make .venv and build/ in a copy of the checkout"

compiler=$CC
for candidate in cc gcc clang; do
    [ -n "$compiler" ] && break
    command -v "$candidate" >/dev/null 2>&1 && compiler=$candidate
done
# $CC may hold arguments ("ccache gcc"), hence no quotes around it. A compiler without the C library's headers is not sufficient.
if [ -z "$compiler" ]; then
    missing "a C compiler is missing: install one (Debian, Ubuntu: apt install gcc libc6-dev; macOS: xcode-select --install)"
elif ! printf '#include <math.h>\n' | $compiler -E -x c - >/dev/null 2>&1; then
    missing "the C compiler '$compiler' cannot be run or has no C library headers: install them (Debian, Ubuntu: apt install gcc libc6-dev) or set CC"
fi

exit "$status"
