#!/usr/bin/env bash
#
# bash benchmarks/install_peers.sh   installs what yielding.py and shells.py here run beside flexmbd, in some minutes:
#
#   kratos              KratosMultiphysics and three of its applications, of PyPI
#   external_operator   dolfinx-external-operator with DOLFINx 0.11, numba and jax, of PyPI
#   calculix            Debian's calculix-ccx with its libraries, where apt has it (Debian 12; needs root)
#
# Each gets a folder of its own in the cache folder, so that neither this checkout nor what ./run set up changes; remove
# the folder `peers` there to be rid of them. What cannot be installed is left out, with a word.

# shellcheck disable=SC2317,SC2329  # functions are called by their names in a variable

set -uo pipefail
cd "$(dirname "$0")/.." || exit
peers=${FLEXMBD_CACHE:-${XDG_CACHE_HOME:-$HOME/.cache}/flexmbd}/peers
mkdir -p "$peers"
left=0

say() { printf 'install_peers: %s\n' "$*" >&2; }

# with_python FOLDER PACKAGE...: a virtual environment of the python that ./run has
with_python() {
    local folder=$peers/$1
    shift
    [[ -e $folder/whole ]] && return
    rm -rf "$folder"
    ./run python3 -m venv --without-pip "$folder" &&
        ./run python3 -m pip --quiet --python "$folder/bin/python" install "$@"
}

# Its wheel of DOLFINx has another name than the one that it asks for.
operator() {
    with_python external_operator dolfinx-solver-real==0.11.0.post0 numba jax &&
        ./run python3 -m pip --quiet --python "$peers/external_operator/bin/python" install --no-deps \
            dolfinx-external-operator==0.11.0
}

kratos() {
    with_python kratos KratosMultiphysics KratosStructuralMechanicsApplication KratosConstitutiveLawsApplication \
        KratosLinearSolversApplication numpy
}

# The program with all that it loads, its loader too, since ./run may enter another Debian than this one.
calculix() {
    local folder=$peers/calculix program loader
    type -P ccx >/dev/null || apt-get install -y -qq calculix-ccx >/dev/null || return
    program=$(type -P ccx)
    mkdir -p "$folder/lib"
    ldd "$program" | awk '$2 == "=>" { print $3 } $1 ~ /^\// { print $1 }' | xargs -I{} cp -L {} "$folder/lib/" &&
        cp "$program" "$folder/lib/program" || return
    loader=$(cd "$folder/lib" && ls ld-linux-*)
    # shellcheck disable=SC2016  # for the shell that runs it
    printf '#!/bin/sh\nhere=$(dirname "$0")/lib\nexec "$here/%s" --library-path "$here" "$here/program" "$@"\n' \
        "$loader" >"$folder/ccx" && chmod +x "$folder/ccx"
}

for peer in kratos operator calculix; do
    say "$peer ..."
    folder=$peers/${peer/operator/external_operator}
    if "$peer"; then
        touch "$folder/whole"
        say "... is in $folder"
    else
        left=1
        say "... left out: it could not be installed"
    fi
done
exit $left
