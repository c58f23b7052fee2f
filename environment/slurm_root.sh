# Sourced by ../headstock: the private root of `campaign slurm`, with a real Slurm in it, in namespaces that end with the command.

# asked_for_slurm_trial ARGS: whether this is `campaign slurm` and the root for it is still to be entered.
asked_for_slurm_trial() {
    [ "${1:-}" = campaign ] || return 1
    shift
    # options may stand before the name
    while [ $# -gt 0 ]; do
        case $1 in
            --runs | --seed | --json) shift; [ $# -eq 0 ] || shift ;;
            -*) shift ;;
            *) break ;;
        esac
    done
    [ "${1:-}" = slurm ] || return 1
    [ ! -e /etc/headstock-root ] || [ -n "${HEADSTOCK_PRIVATE_ROOT:-}" ]
}

# Slurm's daemons start jobs as other users, which bwrap forbids; so a real chroot, with processes, mounts and a host name of
# its own. /run is in memory, and everything the trial makes lies there.
select_slurm_root() {
    [ "$me" = 0 ] || fail "campaign slurm starts the daemons of a real Slurm and needs root: sudo $HEADSTOCK_COMMAND campaign slurm"
    [ -n "$dry_run" ] || unshare --mount --pid --uts --fork true 2>/dev/null || fail "campaign slurm needs mounts and processes of its own, \
which this machine does not allow; start the container with --privileged"
    package_lists="$package_lists
$project/environment/slurm_packages.txt"
    root=$(root_path)
    python=/usr/bin/python3
    if root_complete "$root"; then return; fi
    if [ -n "$dry_run" ]; then say "would build $root"; else build_root; fi
}

# Killed at any time, the launcher takes unshare with it, unshare the first process inside, and that one all others and the mounts.
enter_slurm_root() {
    HEADSTOCK_VIEW=$cache/view PATH=$inner_path "$(command -v setpriv)" --pdeathsig KILL unshare --mount --pid --uts --fork --kill-child --propagation private \
        sh "$project/environment/chroot.sh" --chdir "$PWD" "$@"
}
