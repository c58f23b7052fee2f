# The launcher, sourced by ../headstock and by installed.sh, which set: project, this checkout or the installed package; installed, empty in
# a checkout; launcher, the file that starts this again.

dry_run=${HEADSTOCK_DRY_RUN:-}

me=$(id -u)
newline='
'

say() { printf 'headstock: %s\n' "$*" >&2; }
fail() { say "$@"; exit 1; }

# The folder `headstock` with links to the layers, as a clone has it; archives of the source have no links.
lay_links() {
    for typed in "$project"/*/py.typed; do
        layer=$(basename -- "${typed%/py.typed}")
        if [ "$layer" != api ]; then set -- "$@" "$layer"; continue; fi
        for file in "$project"/api/*; do [ ! -f "$file" ] || set -- "$@" "api/$(basename -- "$file")"; done
    done
    mkdir -p -- "$project/.typing/headstock"
    for place; do ln -sf -- "../../$place" "$project/.typing/headstock/${place#api/}"; done
}

[ -n "$installed" ] || [ -e "$project/.typing" ] || lay_links
[ -n "$installed" ] || [ -d "$project/.typing/headstock/app/" ] || fail "$project/.typing holds files where links should be: clone it with git to a file \
system that knows symbolic links, or there: git config core.symlinks true && git checkout -- .typing"

. "$project/environment/cache_folder.sh"
. "$project/environment/find_python.sh"
. "$project/environment/build_root.sh"
. "$project/environment/pip_group.sh"
. "$project/environment/settings.sh"
. "$project/environment/enter_root.sh"
. "$project/environment/host_commands.sh"

mode=program ranks=1 group= slurm_trial= dolfinx=
case ${1:-} in
    --with | --with=*)
        case $1 in
            --with) dolfinx=${2:-}; [ $# -lt 2 ] || shift ;;
            *) dolfinx=${1#--with=} ;;
        esac
        shift
        [ "$dolfinx" = dolfinx-new ] || fail "write --with dolfinx-new before a command, or another group after exec: exec --with lint" ;;
esac
case $installed${1:-} in
    test)
        mode=test group=tests; shift
        ! asks_for_slurm "$@" || { slurm_trial=1 group=; . "$project/tests/faults/slurm_root.sh"; } ;;
    exec)
        mode=exec; shift
        case ${1:-} in
            --with) group=${2:-}; [ $# -ge 2 ] || fail "--with needs a group: lint, tests or benchmarks"; shift 2 ;;
            --with=*) group=${1#--with=}; shift ;;
        esac
        [ $# -gt 0 ] || fail "write a command after exec, as in: ./headstock exec python3"
        [ -z "$group" ] || [ -f "$project/environment/$group.txt" ] || fail "no group '$group': write lint, tests or benchmarks" ;;
    docs) mode=docs group=docs; shift ;;
    release-check) mode=release; shift ;;
    python | notebook | installedpython | installednotebook)
        mode=$1; shift
        [ -n "$installed" ] || group=python
        if [ "$mode" = python ] && [ "${1:-}" = --ranks ]; then
            ranks=$(ranks_asked_for "$@")
            [ $# -ge 3 ] || fail "write a script after the ranks, as in: ./headstock python --ranks 2 script.py"
            shift 2
        fi ;;
    *)
        ranks=$(ranks_asked_for "$@") ;;
esac

choose_home
cache=${XDG_CACHE_HOME:-$HOME/.cache}/headstock
case $cache in /*) ;; *) cache=$(pwd -P)/$cache ;; esac
choose_cache
# sets python; root is empty when that Python is used directly
if [ -n "$slurm_trial" ]; then select_slurm_root; else select_environment; fi
[ -z "$root" ] || require_unchanged
if [ "$ranks" -gt 1 ] && [ "${SLURM_JOB_NUM_NODES:-1}" -gt 1 ]; then
    [ "$mode" != python ] || set -- python --ranks "$ranks" "$@"
    start_over_nodes "$@"
fi
export_settings             # threads, MPI, paths
[ -n "$slurm_trial" ] || { install_pictures; install_test_data; }
case $installed$mode in notebook | docs) require_pip_group notebook || exit 1; notebook_folder=$group_folder ;; esac
case "$mode $*" in "test "*neighbours*) require_pip_group neighbours || exit 1 ;; esac
[ "$mode" != docs ] || require_pip_group python || exit 1
[ -z "$group" ] || require_pip_group "$group" || [ "$mode" = test ] || exit 1
# last, because it puts another Python in place of the one that groups are for
[ -z "$dolfinx" ] || require_dolfinx "$dolfinx" || exit 1

case $mode in
    program) set -- "$python" -P -m headstock.app.command_line "$@" ;;
    python) set -- "$python" "$@" ;;
    notebook)
        # its server and its kernels import nothing of the working folder while they start; a kernel then looks there, as notebooks expect
        export PYTHONSAFEPATH=1
        # its pages lie beside it, not where the Python's own files are
        [ -n "$installed" ] || export JUPYTERLAB_DIR="$notebook_folder/share/jupyter/lab"
        set -- "$python" -P -m jupyterlab "$@" ;;
    docs) set -- "$python" -P "$project/docs/site/build.py" "$@" ;;
    release) set -- "$python" -P "$project/.ci/release_check.py" "$@" ;;
    test)
        cd -- "$project"
        # with a debugger or a choice of the caller's own, no workers; pytest takes the last -n it is given
        workers=$(test_workers "$@")
        read_only_checkout && set -- -p no:cacheprovider "$@"
        set -- "$python" -P -m pytest -n "$workers" --dist worksteal "$@" ;;
esac
if [ "$ranks" -gt 1 ] || is_rank; then
    # mpi4py's runner turns an exception on one rank into an abort of all, with that exit code
    # of a script's own, which puts its folder in place of the first path: that one is nothing
    case $mode in
        python) shift; export PYTHONPATH="/dev/null${PYTHONPATH:+:$PYTHONPATH}"; set -- "$python" -P -m mpi4py "$@" ;;
        program) shift 2; set -- "$python" -P -m mpi4py "$@" ;;
    esac
fi
if [ "$ranks" -gt 1 ]; then
    mpirun=$(mpirun_of "$python")
    set -- --bind-to none -n "$ranks" "$@"
    # MPICH lets ranks share cores without being told
    ! is_open_mpi "$mpirun" || set -- --oversubscribe "$@"
    set -- "$mpirun" "$@"
    set -- /bin/sh "$project/environment/start_ranks.sh" "$@"
fi

if [ -n "$slurm_trial" ]; then
    # the shell stays the first process inside, which takes leave of those that lost their parent
    export TMPDIR=/run
    HEADSTOCK_ENTER=slurm own_places="--proc /proc --tmpfs /run --hostname localhost" writable_run=/var
    set -- /bin/sh -c '"$@"; exit $?' sh "$@"
fi
if [ -n "$root" ]; then
    [ "$mode$dry_run" != program ] || ! computes_elsewhere "$@" || start_host_commands
    enter_root "$@"
elif [ -n "$dry_run" ]; then
    printf '%s\n' "$@"
else
    PATH=$inner_path
    exec "$@"
fi
