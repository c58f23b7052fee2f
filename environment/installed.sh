#!/bin/sh
# The launcher of an installed package, which `headstock` on PATH starts (app/start.py) with HEADSTOCK_PYTHON set to its Python.
set -eu
project=$(dirname -- "$(readlink -f -- "$0")")
project=$(cd -- "$project/.." && pwd -P)
export HEADSTOCK_COMMAND=headstock
installed=installed launcher=$project/environment/installed.sh
[ -n "${HEADSTOCK_PYTHON:-}" ] || { echo "headstock: start this with headstock, which names its Python" >&2; exit 1; }
. "$project/environment/launcher.sh"
