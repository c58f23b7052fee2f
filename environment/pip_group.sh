# Sourced by ../headstock: pinned pip packages beside the environment, installed when first asked for.

# install_pip_group GROUP: puts the packages of environment/GROUP.txt on PATH and PYTHONPATH; false where they are not to be had.
install_pip_group() {
    requirements=$project/environment/$1.txt
    key=$({ echo "$root $python"; cat -- "$requirements"; } | sha256sum | cut -c1-12)
    group_folder=$cache/pip-$1-$key
    if [ -z "$dry_run" ] && [ ! -d "$group_folder" ]; then
        mkdir -p -- "$cache"
        exec 8>"$cache/pip.lock"
        flock 8
        filled=yes
        [ -d "$group_folder" ] || fill_pip_group "$1" || filled=
        exec 8>&-
        [ -n "$filled" ] || return 1
    fi
    inner_path=$group_folder/bin:$inner_path
    PYTHONPATH=$PYTHONPATH:$group_folder
}

fill_pip_group() {
    say "installing the packages of environment/$1.txt (once)"
    growing=$group_folder.growing.$$
    log=$cache/pip-$1.log
    if ! (run_inside "$python" -m pip install --quiet --require-hashes --no-deps --no-build-isolation \
        --target "$growing" -r "$requirements") >"$log" 2>&1; then
        rm -rf -- "$growing"
        tail -n 15 -- "$log" >&2
        say "pip could not install environment/$1.txt; the whole log is $log"
        return 1
    fi
    mv -- "$growing" "$group_folder"
}

run_inside() { if [ -n "$root" ]; then enter_root "$@"; else "$@"; fi; }
