#!/usr/bin/env bash
# Builds MBDyn from a source that is at hand into the environment of ./run, where tests and demos find it:
#
#   ./run --tools tools/build_mbdyn.sh mbdyn-1.7.3.tar.gz      # or an unpacked folder; some ten minutes on two processors
#   ./run pytest tests/export/test_mbdyn.py            # test_mbdyn_moves_as_we_do runs then
#
# Nothing is downloaded. The flags are those with which 1.7.3 was built by hand for docs/export/mbdyn.md: its sources are
# older than today's g++ takes by default. The script itself has not been run: no source of MBDyn was at hand.
set -euo pipefail

fail() { echo "build_mbdyn.sh: $*" >&2; exit 1; }

(($# == 1)) || fail "give the source of MBDyn, mbdyn-1.7.3.tar.gz or its unpacked folder (https://www.mbdyn.org, downloads)"
[[ -e $1 ]] || fail "there is no $1"
[[ -n ${FLEXMBD_ENV:-} ]] || fail "call it by ./run --tools, which says where the environment is"
command -v g++ >/dev/null && command -v make >/dev/null || fail "g++ and make are needed: call it by ./run --tools"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
if [[ -d $1 ]]; then
    cp -r "$1/." "$work"
else
    tar -xf "$1" -C "$work" --strip-components=1
fi
cd "$work"
if [[ ! -x configure ]]; then
    [[ -e bootstrap.sh ]] || fail "$1 has neither configure nor bootstrap.sh: is it MBDyn's source?"
    sh bootstrap.sh # of a git clone; needs autoconf, automake and libtool
fi
# its own solver is enough for the decks that flexmbd writes; no modules
./configure --quiet --prefix="$FLEXMBD_ENV" --disable-Werror --with-lapack=no --enable-runtime-loading=no \
    CXXFLAGS="-O2 -std=c++14 -fpermissive -w" CFLAGS="-O2 -w"
make -j "$(nproc)" --silent
make install --silent
"$FLEXMBD_ENV/bin/mbdyn" --version | head -n 2
