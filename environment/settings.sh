# Sourced by ../headstock: ranks, threads, MPI and the paths Python looks in.

# ranks_asked_for ARGS: the N of --ranks N; 1 when there is none, when it is no number (the program says what is wrong with it)
# when the ranks are those of a job on a cluster (--on), or when this is a rank already.
ranks_asked_for() {
    asked=1 previous= elsewhere=
    for word; do
        case $word in --on | --on=*) elsewhere=1 ;; esac
        case $word in --ranks=*) asked=${word#--ranks=} ;; esac
        [ "$previous" != --ranks ] || asked=$word
        [ "$word" != -- ] || break
        previous=$word
    done
    case $asked in '' | *[!0-9]* | ?????*) asked=1 ;; esac
    if [ -n "$elsewhere" ] || is_rank; then asked=1; fi
    echo "$asked"
}

# An mpirun of the caller's (Open MPI's or MPICH's) or a srun --mpi=pmix started this as one of several.
is_rank() { [ -n "${OMPI_COMM_WORLD_SIZE:-}${PMIX_RANK:-}" ] || [ -n "${PMI_SIZE:-}" ]; }

# Whether the other ranks run on other nodes, too.
spans_nodes() {
    if [ -n "${OMPI_COMM_WORLD_SIZE:-}" ]; then
        [ "${OMPI_COMM_WORLD_LOCAL_SIZE:-$OMPI_COMM_WORLD_SIZE}" != "$OMPI_COMM_WORLD_SIZE" ]
    else
        [ -n "${PMIX_RANK:-}" ] && [ "${SLURM_STEP_NUM_NODES:-1}" -gt 1 ]
    fi
}

# start_over_nodes ARGS: ranks in an allocation of several nodes. Each is a launcher of its own, which enters the root on its node:
# an mpirun inside the root reaches no other node. srun ends the others where one was killed.
start_over_nodes() {
    command -v srun >/dev/null || fail "this job has $SLURM_JOB_NUM_NODES nodes, and there is no srun on PATH to start ranks on them"
    [ -n "$dry_run" ] || srun --mpi=list 2>&1 | grep -qw pmix || fail "this job has $SLURM_JOB_NUM_NODES nodes, and its Slurm cannot start \
ranks on them (srun --mpi=list does not name pmix): ask for one node with --nodes=1"
    nodes=$SLURM_JOB_NUM_NODES
    [ "$nodes" -le "$ranks" ] || nodes=$ranks
    set -- srun --mpi=pmix --nodes="$nodes" --ntasks="$ranks" --cpus-per-task="${SLURM_CPUS_PER_TASK:-1}" --cpu-bind=none --export=ALL \
        --kill-on-bad-exit=1 "$launcher" "$@"
    if [ -n "$dry_run" ]; then printf '%s\n' "$@"; exit 0; fi
    exec "$@"
}

cores() {
    count=$(env -u OMP_NUM_THREADS -u OMP_THREAD_LIMIT nproc)
    if read -r quota period 2>/dev/null </sys/fs/cgroup/cpu.max && [ "$quota" != max ]; then
        allowed=$(((quota + period - 1) / period))
        [ "$allowed" -ge "$count" ] || count=$allowed
    fi
    echo "$count"
}

# Cores nobody uses, at least 1, at most 4 (as in solvers/shared_work.py): a BLAS with more threads than free cores is several
# times slower than one thread; from 4 to 8 a run of 300k dofs would gain 8 % (benchmarks/ranks.py --threads).
free_threads() {
    read -r load _ </proc/loadavg || load=0
    free=$(($(cores) - ${load%%.*}))
    [ "$free" -ge 1 ] || free=1
    [ "$free" -le 4 ] || free=4
    echo "$free"
}

# asks_for_slurm ARGS: whether the tests of a real Slurm are named and the root for them is still to be entered.
asks_for_slurm() {
    case " $*" in *faults/test_slurm.py* | *faults/test_nodes.py*) [ ! -e /etc/headstock-root ] || [ -n "${HEADSTOCK_PRIVATE_ROOT:-}" ] ;; *) false ;; esac
}

test_workers() {
    for word; do
        case $word in --pdb | --trace | -s | --capture=no | --co | --collect-only | --version | --help) echo 0; return ;; esac
    done
    workers=$(cores)
    [ "$workers" -le 4 ] || workers=4
    echo "$workers"
}

# root may write everywhere, so ask the folder's mode and not only the kernel
read_only_checkout() { [ ! -w "$project" ] || [ -z "$(find "$project" -maxdepth 0 -perm -u+w)" ]; }

mpirun_of() {
    beside=$(dirname -- "$1")/mpirun
    if [ -n "$root" ] || [ -x "$beside" ]; then echo "$beside"; else echo mpirun; fi
}

# is_open_mpi MPIRUN: whether it is Open MPI's; that of the private root is, that of dolfinx-new.txt is MPICH's.
is_open_mpi() {
    [ -z "$dolfinx" ] || return 1
    [ -z "$root" ] || return 0
    case $("$1" --version 2>/dev/null) in *"Open MPI"* | *PRRTE* | *prte*) return 0 ;; esac
    return 1
}

# OpenBLAS knows CPUs by their number and takes slow kernels for one that is newer than itself. Where the CPU has AVX-512 and
# OpenBLAS did not see it, name the kernels for it. Asked once per CPU and environment.
blas_kernels() {
    grep -qw avx512vl /proc/cpuinfo 2>/dev/null || return 0
    known=$({ echo "$root"; grep -m 1 'model name' /proc/cpuinfo; } | sha256sum)
    known=$cache/blas-${known%"${known#????????????}"}
    if [ ! -f "$known" ]; then
        seen=$(cd -- "$project/environment" && run_inside "$python" -P -c "$blas_code" 2>/dev/null) || seen=unknown
        case $seen in Prescott | Core2 | Nehalem | Sandybridge | Generic) kernels=SkylakeX ;; *) kernels= ;; esac
        mkdir -p -- "$cache"
        echo "$kernels" >"$known.$$" && mv -f -- "$known.$$" "$known"
    fi
    cat -- "$known"
}

blas_code='
import numpy.linalg, threadpoolctl
print(*{library.get("architecture") for library in threadpoolctl.threadpool_info() if library["internal_api"] == "openblas"})
'

# named_folders LIST: a list of folders without its empty entries, which would be the working folder.
named_folders() {
    named=
    rest=$1:
    while [ -n "$rest" ]; do
        first=${rest%%:*} rest=${rest#*:}
        [ -z "$first" ] || named=$named${named:+:}$first
    done
    printf '%s\n' "$named"
}

export_settings() {
    OPENBLAS_CORETYPE=${OPENBLAS_CORETYPE:-}
    inner_path=$PATH
    threads=1
    if [ "$mode" != test ] && [ "$ranks" = 1 ] && ! is_rank; then threads=$(free_threads); fi
    threads=${HEADSTOCK_THREADS:-${OMP_NUM_THREADS:-$threads}}
    export OMP_NUM_THREADS="$threads" OPENBLAS_NUM_THREADS="$threads"
    # CHOLMOD's threads that wait in a loop take the cores from those of OpenBLAS: 2.4 s for a factor that takes 1.7 without
    export OMP_WAIT_POLICY="${OMP_WAIT_POLICY:-PASSIVE}"
    if [ -n "$root" ]; then
        # nothing of the host's own Pythons, compilers and libraries reaches the private root
        unset PYTHONHOME PYTHONSTARTUP PYTHONUSERBASE LD_LIBRARY_PATH LD_PRELOAD VIRTUAL_ENV CONDA_PREFIX \
            PETSC_DIR PETSC_ARCH SLEPC_DIR CC CXX CFLAGS CXXFLAGS CPPFLAGS LDFLAGS
        export LC_ALL=C.UTF-8 PYTHONNOUSERSITE=1
        inner_path=/usr/local/bin:/usr/bin:/bin:/usr/sbin:/sbin
        PYTHONPATH=
    fi
    PYTHONPATH=$(named_folders "${PYTHONPATH:-}")
    if [ -n "${LD_LIBRARY_PATH:-}" ]; then LD_LIBRARY_PATH=$(named_folders "$LD_LIBRARY_PATH"); export LD_LIBRARY_PATH; fi
    # an installed package is found without
    if [ -z "$installed" ]; then PYTHONPATH=$project/.typing${PYTHONPATH:+:$PYTHONPATH}; fi
    export PYTHONPATH="${PYTHONPATH:-}"
    unset PYTHONDONTWRITEBYTECODE
    # without a display VTK looks for one first, and says so
    if [ -z "${DISPLAY:-}" ]; then export VTK_DEFAULT_OPENGL_WINDOW="${VTK_DEFAULT_OPENGL_WINDOW:-vtkEGLRenderWindow}"; fi
    if read_only_checkout; then export PYTHONPYCACHEPREFIX="$cache/bytecode"; fi
    # on one node shared memory only; UCX would look for a network first and complain where it finds none
    transports=self,sm
    if spans_nodes; then transports=self,sm,tcp; fi
    # more ranks than cores: mpirun says so to them, srun does not
    if is_rank; then export OMPI_MCA_mpi_yield_when_idle="${OMPI_MCA_mpi_yield_when_idle:-1}"; fi
    export OMPI_MCA_btl="${OMPI_MCA_btl:-$transports}" OMPI_MCA_pml="${OMPI_MCA_pml:-ob1}" OMPI_MCA_osc="${OMPI_MCA_osc:-^ucx}"
    # PETSc would end the process at a closed pipe, with a page of advice
    export PETSC_OPTIONS="-no_signal_handler${PETSC_OPTIONS:+ $PETSC_OPTIONS}"
    export UCX_LOG_LEVEL="${UCX_LOG_LEVEL:-fatal}"
    # pydantic would ask every installed package for plugins, which the program has none of
    export PYDANTIC_DISABLE_PLUGINS="${PYDANTIC_DISABLE_PLUGINS:-__all__}"
    # and check the rules that it has just built, a hundredth of a second for each table of a scene
    export PYDANTIC_SKIP_VALIDATING_CORE_SCHEMAS="${PYDANTIC_SKIP_VALIDATING_CORE_SCHEMAS:-1}"
    # inside a container the kernel may refuse one process to read another's memory
    export OMPI_MCA_smsc="${OMPI_MCA_smsc:-^cma}"
    if [ "$me" = 0 ]; then export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1; fi
    if [ -z "$dry_run$OPENBLAS_CORETYPE" ]; then OPENBLAS_CORETYPE=$(blas_kernels); fi
    if [ -n "$OPENBLAS_CORETYPE" ]; then export OPENBLAS_CORETYPE; else unset OPENBLAS_CORETYPE; fi
}
