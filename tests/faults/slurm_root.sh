# Sourced by ../../headstock: the private root of `test tests/faults/test_slurm.py` and `test_nodes.py`, with a real Slurm in it, in namespaces that end with the command.

# Slurm's daemons start jobs as other users, which bwrap forbids; so a real chroot, with processes, mounts and a host name of
# its own. /run is in memory, and everything the trial makes lies there.
select_slurm_root() {
    [ "$me" = 0 ] || fail "this test starts the daemons of a real Slurm and needs root: write sudo before the command"
    [ -n "$dry_run" ] || unshare --mount --pid --uts --fork true 2>/dev/null || fail "this test needs mounts and processes of its own, \
which this machine does not allow; start the container with --privileged"
    package_lists="$package_lists
$project/tests/faults/slurm_packages.txt"
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
