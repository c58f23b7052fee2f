# Sourced by ../headstock: pinned pip packages beside the environment, installed when first needed.

# install_pip_group GROUP [OPTION ...]: puts the packages of environment/GROUP.txt on PATH and PYTHONPATH, installed by pip with these
# options; false where they are not to be had, and then the log says why.
install_pip_group() {
    requirements=$project/environment/$1.txt
    log=$cache/pip-$1.log
    environment=${root##*/}
    # inside a root its own groups are found again
    if [ -z "$root" ] && [ -e /etc/headstock-root ]; then read -r environment </etc/headstock-root; fi
    # programs of Debian that it takes besides
    programs=$project/environment/$1.packages
    [ -f "$programs" ] || programs=
    key=$({ echo "$environment $python"; cat -- "$requirements" ${programs:+"$programs"}; } | sha256sum)
    group_folder=$cache/pip-$1-${key%"${key#????????????}"}
    shift
    if [ -z "$dry_run" ] && [ ! -d "$group_folder" ]; then
        mkdir -p -- "$cache"
        exec 8>"$cache/pip.lock"
        flock 8
        filled=yes
        [ -d "$group_folder" ] || fill_pip_group "$@" || filled=
        exec 8>&-
        [ -n "$filled" ] || return 1
    fi
    inner_path=$group_folder/bin:$inner_path
    PYTHONPATH=$PYTHONPATH:$group_folder
}

fill_pip_group() {
    growing=$group_folder.growing.$$
    if [ -z "$root" ] && [ -n "${found_code:-}" ] && (cd -- "$project/environment" && "$python" -P -c "$found_code" 2>/dev/null); then
        mkdir -- "$group_folder"
        return
    fi
    say "installing the packages of environment/${requirements##*/} (once)"
    if [ -n "${as_environment:-}" ]; then
        (cd -- "$project/environment" && run_inside "$python" -P -m venv --system-site-packages --without-pip "$growing") >"$log" 2>&1 || { rm -rf -- "$growing"; return 1; }
    else
        set -- --target "$growing" "$@"
    fi
    # from a folder of ours, and with -P: modules of the working folder are not pip's
    if ! (cd -- "$project/environment" && run_inside "$python" -P -m pip ${as_environment:+--python "$growing/bin/python3"} install --quiet --require-hashes --no-deps \
        --no-build-isolation --disable-pip-version-check -r "$requirements" "$@") >"$log" 2>&1; then
        rm -rf -- "$growing"
        return 1
    fi
    # without a root there may be no apt: tests that need the programs are skipped
    [ -z "$programs" ] || [ -z "$root" ] || unpack_programs || { rm -rf -- "$growing"; return 1; }
    # the symbol tables of VTK's libraries are a quarter of their size
    # in a shell of its own, as above: entering the root changes the settings of certificates, which the next group needs as they are
    [ ! -d "$growing/vtkmodules" ] || (run_inside find "$growing/vtkmodules" -name '*.so*' -exec strip --strip-unneeded {} +) >>"$log" 2>&1 || :
    mv -- "$growing" "$group_folder"
}

# Programs of an earlier Debian and their libraries, unpacked into the group: apt checks their signatures with the root's keys.
unpack_programs() {
    # shellcheck disable=SC2016
    (run_inside sh -euc '
        list=$1 growing=$2 final=$3
        apt=$growing/apt debian=$growing/debian
        mkdir -p "$apt/lists/partial" "$apt/archives/partial" "$debian" "$growing/bin"
        sed -n "s/^\\(deb [^ ]*\\) trixie main/\\1 bookworm main/p" /etc/apt/sources.list >"$apt/sources.list"
        cd "$apt"
        set -- -q -o "Dir::State=$apt" -o "Dir::Cache=$apt" -o Dir::State::status=/var/lib/dpkg/status \
            -o "Dir::Etc::sourcelist=$apt/sources.list" -o Dir::Etc::sourceparts=- -o APT::Sandbox::User=
        apt-get "$@" update
        apt-get "$@" download $(grep -v "^#" "$list")
        for package in *.deb; do dpkg-deb -x "$package" "$debian"; done
        for program in "$debian"/usr/bin/*; do
            name=${program##*/}
            printf "#!/bin/sh\nLD_LIBRARY_PATH=%s exec %s \"\$@\"\n" "$final/debian/usr/lib/x86_64-linux-gnu" "$final/debian/usr/bin/$name" >"$growing/bin/$name"
            chmod 755 "$growing/bin/$name"
        done
        rm -rf -- "$apt"' sh "$programs" "$growing" "$group_folder") >>"$log" 2>&1
}

# A group that was asked for: its log's end where it cannot be had.
require_pip_group() {
    if ! install_pip_group "$1"; then
        tail -n 15 -- "$log" >&2
        say "pip could not install environment/$1.txt; the whole log is $log"
        return 1
    fi
}

# A newer dolfinx with its own PETSc, SLEPc and MPI, in place of the environment's: its loader finds MPI only in an environment of its
# own, which takes all else from the one it was made of.
require_dolfinx() {
    as_environment=1
    if require_pip_group "$1"; then installed_well=yes; else installed_well=; fi
    as_environment=
    [ -n "$installed_well" ] || return 1
    # not where it would hide the standard library or what is found before
    PYTHONPATH=${PYTHONPATH%":$group_folder"}
    python=$group_folder/bin/python3
    export LD_LIBRARY_PATH="$group_folder/lib"
}

# install_for_all GROUP CODE WITHOUT: the packages of a group for every command, unless CODE finds them in the environment. Without a
# registry the program goes on and says what it goes on without; the next try is ten minutes later, so that not every command waits for it.
install_for_all() {
    # a Python of the caller's own choice is taken as it is, and who started us inside a root brought the group along
    case ${HEADSTOCK_PYTHON:+chosen}$PYTHONPATH in chosen* | */pip-"$1"-*) return 0 ;; esac
    failed=$cache/pip-$1.failed
    [ -z "${_HEADSTOCK_COMPLETE:-}" ] || return 0
    [ ! -e "$failed" ] || [ -z "$(find "$failed" -mmin -10 2>/dev/null)" ] || return 0
    found_code=$2
    if install_pip_group "$1" --only-binary :all: --retries 0 --timeout 8; then found_code=; return; fi
    found_code=
    : >"$failed"
    say "no $3: pip could not install environment/$1.txt; the log is $log"
}

install_pictures() { install_for_all pictures "$pictures_code" "pictures of the machine"; }
install_test_data() { install_for_all test_data "import pyuff" "universal files (UFF)"; }

# whether the environment itself has a VTK that draws without a display
pictures_code='
import pyvista
from vtkmodules.vtkRenderingOpenGL2 import vtkEGLRenderWindow
'

run_inside() { if [ -n "$root" ]; then enter_root "$@"; else "$@"; fi; }
