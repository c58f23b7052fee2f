# Sourced by ../headstock: which Python runs the code.

probe_code='
import importlib.util, sys
if sys.version_info < (3, 13) or importlib.util.find_spec("dolfinx") is None:
    sys.exit(1)
needed = "slepc4py mpi4py gmsh numpy scipy h5py pydantic typer rich matplotlib jinja2 meshio".split()
if any(importlib.util.find_spec(name) is None for name in needed):
    sys.exit(1)
import dolfinx, numpy, os
from petsc4py import PETSc
if dolfinx.__version__.split(".")[:2] != ["0", "9"] or PETSc.ScalarType is not numpy.float64:
    sys.exit(1)
print(os.path.dirname(dolfinx.__file__))
'

modified() { stat -L -c %Y -- "$1" 2>/dev/null || echo none; }

# Sets python and root. Order: asked for, the private root we are in, known to fit, built, probed, apt line, build.
select_environment() {
    root=
    if [ -n "${HEADSTOCK_PYTHON:-}" ]; then
        # a path below the working folder, which is left now and then
        case $HEADSTOCK_PYTHON in /*) python=$HEADSTOCK_PYTHON ;; */*) python=$(pwd -P)/$HEADSTOCK_PYTHON ;; *) python=$HEADSTOCK_PYTHON ;; esac
        return
    fi
    if [ -z "${HEADSTOCK_PRIVATE_ROOT:-}" ]; then
        if [ -e /etc/headstock-root ]; then python=/usr/bin/python3; return; fi
        known_python && return
    fi
    root=$(root_path)
    python=/usr/bin/python3
    if root_complete "$root"; then return; fi
    if [ -z "${HEADSTOCK_PRIVATE_ROOT:-}" ]; then
        if probe_pythons; then root=; return; fi
        suggest_apt /etc/os-release
    fi
    # a shell that completes a command is no reason to build for minutes
    [ -z "${_HEADSTOCK_COMPLETE:-}" ] || exit 0
    if [ -n "$dry_run" ]; then say "would build $root"; else build_root; fi
}

# A Python that passed the probe before, as long as neither it nor its dolfinx changed since.
known_python() {
    [ -f "$cache/python" ] || return 1
    { read -r python && read -r stamp && read -r package && read -r package_stamp; } <"$cache/python" || return 1
    [ "$(modified "$python")" = "$stamp" ] && [ "$(modified "$package")" = "$package_stamp" ]
}

probe_pythons() {
    for candidate in python3 /usr/bin/python3; do
        candidate=$(command -v "$candidate") || continue
        # what it loads looks for settings, and for code, where it stands
        if package=$(cd -- "$project/environment" && "$candidate" -P -c "$probe_code" 2>/dev/null); then
            python=$candidate
            mkdir -p -- "$cache"
            printf '%s\n' "$python" "$(modified "$python")" "$package" "$(modified "$package")" >"$cache/python.$$"
            mv -f -- "$cache/python.$$" "$cache/python"
            return 0
        fi
    done
    return 1
}

# suggest_apt OS_RELEASE: on Debian 13 or newer the packages come from apt, not from a second system.
suggest_apt() {
    [ -r "$1" ] || return 0
    release=$(. "$1" && echo "${ID:-} ${VERSION_ID:-0}")
    case $release in "debian "*) version=${release#debian }; version=${version%%.*} ;; *) return 0 ;; esac
    [ "$version" -ge 13 ] 2>/dev/null || return 0
    say "this Debian has all that is needed; install it with (or set HEADSTOCK_PRIVATE_ROOT=1 to build a private copy):"
    say "  sudo apt-get install --no-install-recommends $(packages | tr '\n' ' ')"
    exit 1
}
