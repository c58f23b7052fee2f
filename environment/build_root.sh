# Sourced by ../headstock: the private Debian 13 root, built once per package list and user.

suite=trixie
need_kb=3500000

# lists of packages: those of the program, and what a command needs besides
package_lists=$project/environment/packages.txt

packages() { printf '%s\n' "$package_lists" | while read -r list; do list_lines "$list"; done; }

# list_lines FILE ...: without comments and empty lines. (Every program that is started costs a command a hundredth of its start.)
list_lines() { grep -hv -e '^#' -e '^$' -- "$@"; }

left_out() { list_lines "$project/environment/left_out.$1"; }

root_path() {
    left_out=$project/environment/left_out
    key=$({ echo "layout 3 $suite"; IFS=$newline; set -f; list_lines $package_lists "$left_out.packages" "$left_out.paths"; } | sha256sum)
    printf '%s\n' "$cache/root-${key%"${key#????????????}"}"
}

root_complete() { [ -e "$1/etc/headstock-root" ]; }

# Owner, mode and time of what a program added to or replaced in the root would change: its folders of programs, libraries and modules.
root_stamp() {
    (cd -- "$root" && stat -c '%n %u %a %Y' -- etc/alternatives etc/ld.so.cache usr usr/bin usr/bin/python3* usr/sbin usr/lib usr/lib/*-linux-gnu \
        usr/lib/python3* usr/lib/python3*/lib-dynload usr/lib/python3/dist-packages usr/lib/python3/dist-packages/*/ usr/local/lib/* 2>/dev/null) || :
}

# Only this launcher's build writes the root, which is entered read-only; the stamp of the first entrance stays true.
require_unchanged() {
    [ -z "$dry_run" ] || return 0
    stamps=$cache/stamp-${root##*/}
    now=$(root_stamp)
    if [ ! -f "$stamps" ]; then
        printf '%s\n' "$now" >"$stamps.$$" && mv -f -- "$stamps.$$" "$stamps"
    elif [ "$now" != "$(cat -- "$stamps")" ]; then
        changed=$(printf '%s\n' "$now" | grep -vxFf "$stamps" | head -n 1)
        fail "the environment in $root is no longer what was built (${changed%% *}): remove that folder and $stamps, the next command builds it anew"
    fi
}

# Atomic: the root grows beside its place and is renamed when it is whole. The lock is this shell's alone: it is free when the
# shell has ended in whatever way, and the build ends with it (guarded). Whoever gets it next clears what that build left.
build_root() {
    mkdir -p -- "$cache"
    exec 9>"$cache/build.lock"
    if ! flock -n 9; then
        say "another headstock is building the environment; waiting for it"
        flock 9
    fi
    if ! root_complete "$root"; then
        require_builders
        remove_leftovers
        check_space
        growing=$root.growing.$$ begun=$(date +%s)
        trap 'stop_build; exit 130' INT
        trap 'stop_build; exit 143' TERM HUP
        mkfifo -- "$growing.guard"
        exec 8<>"$growing.guard"
        fill_root "$growing" "$cache/build.log"
        exec 8>&-
        trap - INT TERM HUP
        basename -- "$root" >"$growing/etc/headstock-root"
        rm -f -- "$growing.pipe" "$growing.guard"
        rm -f -- "$cache/stamp-${root##*/}"
        mv -- "$growing" "$root"
        say "environment ready after $(($(date +%s) - begun)) s, $(du -sm -- "$root" | cut -f1) MB"
    fi
    exec 9>&-
}

fill_root() {
    say "building the environment in $root (once; a few minutes, 2 GB)"
    : >"$2"
    if bootstrap "$1" "$2" && [ -x "$1/usr/bin/python3" ]; then return; fi
    # the mirror this machine's own apt uses, where the default one is out of reach
    remove_tree "$1"
    mirror=$(host_mirror)
    if [ -n "$mirror" ]; then
        say "that failed; trying the mirror of this machine's apt"
        if bootstrap "$1" "$2" "deb $mirror $suite main" && [ -x "$1/usr/bin/python3" ]; then return; fi
    fi
    remove_tree "$1"
    rm -f -- "$1.guard"
    tail -n 15 -- "$2" >&2
    fail "the environment could not be built; the whole log is $2"
}

# bootstrap TARGET LOG [MIRROR]: as root straight into the folder; as an ordinary user through a tar stream, so that the
# files belong to that user and can be removed again.
bootstrap() {
    target=$1 log=$2
    shift 2
    mkdir -- "$target"
    chmod 755 -- "$target"
    set -- --verbose --variant=apt --include="$(packages | tr '\n' ',' | sed 's/,$//')" \
        --aptopt='APT::Install-Recommends "false"' --aptopt='Acquire::Retries "3"' --dpkgopt=force-unsafe-io \
        --extract-hook="$(extracted_hook)" --customize-hook="$(installed_hook)" "$suite" "$target" "$@"
    # in the background and waited for, because a shell answers to signals only between foreground commands
    if [ "$me" = 0 ]; then
        guarded mmdebstrap "$@" >>"$log" 2>&1 8>&- 9>&- &
        builder=$!
        show_steps "$log" 8>&- 9>&- &
        watcher=$!
        wait "$builder"
    else
        mkfifo -- "$target.pipe"
        tar -x -C "$target" --no-same-owner --exclude='./dev/*' <"$target.pipe" >>"$log" 2>&1 8>&- 9>&- &
        unpacker=$!
        for word; do
            shift
            [ "$word" != "$target" ] || word=-
            set -- "$@" "$word"
        done
        guarded mmdebstrap --mode=unshare --format=tar "$@" >"$target.pipe" 2>>"$log" 8>&- 9>&- &
        builder=$!
        show_steps "$log" 8>&- 9>&- &
        watcher=$!
        wait "$builder" && wait "$unpacker"
    fi
    built=$?
    kill "$watcher" 2>/dev/null || :
    return "$built"
}

# Say how far the build is, from its log, as long as it runs.
show_steps() {
    said=
    while sleep 10 >/dev/null 2>&1 && kill -0 "$builder" 2>/dev/null; do
        all=$(sed -n 's/.* upgraded, \([0-9]*\) newly installed.*/\1/p' "$1" | sort -u | awk '{ sum += $1 } END { print sum }')
        step=$(sed -n 's/^\(Get:[0-9]*\|Unpacking\|Setting up\) .*/\1/p; s/^I: running --customize-hook.*/compiling Python modules/p' "$1" | tail -n 1)
        case $step in
            Get:*) step="downloading packages" ;;
            Unpacking | Setting*) step="$(echo "$step" | tr US us) package $(grep -c "^$step " "$1") of ${all:-?}" ;;
        esac
        if [ -n "$step" ] && [ "$step" != "$said" ]; then say "$step"; said=$step; fi
    done
}

# What is done in the root when a bare system lies there unpacked and apt knows the mirror. As text: in a namespace of an ordinary user
# mmdebstrap may read none of that user's files.
extracted_hook() {
    cat <<END
set -eu
root=\$1
# a filter here would read each package of the bare system through Python
rm -rf -- "\$root/usr/share/doc" "\$root/usr/share/man"
cat >"\$root/etc/dpkg/dpkg.cfg.d/headstock" <<'RULES'
$(left_out paths | sed 's/^!/path-include=/; s/^\//path-exclude=\//')
RULES
# an empty package, installed, that provides those which are left out, in the versions that others ask for
provided=\$(chroot "\$root" apt-cache policy $(left_out packages | tr '\n' ' ') | sed -n -e '/^[a-z]/{s/:\$//;h;}' -e '/^ *Candidate: /{s///;H;x;s/\n\(.*\)/ (= \1)/p;}' | paste -sd ,)
cat >>"\$root/var/lib/dpkg/status" <<STATUS

Package: headstock-left-out
Status: install ok installed
Maintainer: Headstock
Architecture: all
Version: 1
Provides: \$provided
Description: packages that the private root of Headstock does without

STATUS
: >"\$root/var/lib/dpkg/info/headstock-left-out.list"
# bytecode is made at the end, on all cores, and not by a Python of its own for each package
printf '%s\n' /usr/bin/py3compile /usr/bin/py3compile.distrib : >"\$root/var/lib/dpkg/diversions"
printf '#!/bin/sh\n' >"\$root/usr/bin/py3compile"
chmod 755 "\$root/usr/bin/py3compile"
END
}

# What is done when all packages are installed. The root is read-only: nobody asks again whether a module has changed.
installed_hook() {
    echo 'chroot "$1" python3 -m compileall -q -j 0 --invalidation-mode unchecked-hash -x "/tests?/" /usr/lib/python3/dist-packages || :'
}

# guarded COMMAND ...: a session of its own, of which nothing is left when this shell ends, even by a signal that no shell can catch: the
# other end of the pipe that one of its processes reads from is open in this shell only.
guarded() {
    exec setsid /bin/sh -c '
        exec 7<"$1"
        shift
        (read -r _ <&7; kill -s KILL -- "-$$") </dev/null >/dev/null 2>&1 &
        exec "$@" 7<&-' sh "$growing.guard" "$@"
}

stop_build() {
    [ -z "${watcher:-}" ] || kill "$watcher" 2>/dev/null || :
    # the whole group: mmdebstrap's first process leaves signals to its children
    [ -z "${builder:-}" ] || kill -- "-$builder" 2>/dev/null || :
    wait 2>/dev/null || :
    remove_tree "$growing"
    rm -f -- "$growing.guard"
    say "stopped; nothing was left behind"
}

remove_tree() { rm -rf -- "$1" "$1.pipe" 2>/dev/null || unshare --map-root-user --map-auto rm -rf -- "$1" || :; }

remove_leftovers() {
    for leftover in "$cache"/root-*.growing.* "$cache"/pip-*.growing.*; do
        [ ! -e "$leftover" ] || remove_tree "$leftover"
    done
}

check_space() {
    free=$(df -Pk -- "$cache" | awk 'NR == 2 { print $4 }')
    [ "$free" -ge "$need_kb" ] || fail "$cache has $((free / 1024)) MB free, $((need_kb / 1024)) are needed: \
free some, or put the cache elsewhere with XDG_CACHE_HOME=/path"
}

require_builders() {
    tools="mmdebstrap bwrap" wanted="mmdebstrap bubblewrap debian-archive-keyring"
    if [ "$me" != 0 ]; then tools="$tools newuidmap" wanted="$wanted uidmap"; fi
    missing=
    for tool in $tools; do command -v "$tool" >/dev/null || missing="$missing $tool"; done
    if [ -n "$missing" ]; then get_builders; fi
    if [ "$me" != 0 ]; then require_namespaces; fi
}

get_builders() {
    if [ "$me" = 0 ] && command -v apt-get >/dev/null; then
        say "installing $wanted with apt-get"
        mkdir -p -- "$cache"
        if ! { apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends $wanted; } \
            >"$cache/apt.log" 2>&1 </dev/null; then
            tail -n 15 -- "$cache/apt.log" >&2
            fail "apt-get failed; the whole log is $cache/apt.log"
        fi
    elif command -v apt-get >/dev/null; then
        fail "missing:$missing. Install with: sudo apt-get install $wanted"
    else
        fail "missing:$missing. Install them with this system's package manager, or point HEADSTOCK_PYTHON at a Python with dolfinx 0.9"
    fi
}

# What mmdebstrap --mode=unshare needs of the kernel and of the user's account, said before anything is downloaded.
require_namespaces() {
    for kind in subuid subgid; do
        has_subordinates "$kind" || fail "$(id -un) has no range of numbers in /etc/$kind for the files of a private system. Give one with: \
sudo usermod --add-subuids 100000-165535 --add-subgids 100000-165535 $(id -un)"
    done
    unshare --user true 2>/dev/null || fail "this machine lets ordinary users make no user namespaces. Allow them with: \
sudo sysctl kernel.unprivileged_userns_clone=1 kernel.apparmor_restrict_unprivileged_userns=0 (those of the two that exist), \
or run ./headstock as root"
}

has_subordinates() {
    grep -qs -e "^$(id -un):" -e "^$(id -u):" "/etc/$1" && return 0
    # accounts kept in a directory service
    command -v getsubids >/dev/null || return 1
    case $1 in subgid) getsubids -g "$(id -un)" >/dev/null 2>&1 ;; *) getsubids "$(id -un)" >/dev/null 2>&1 ;; esac
}

# The Debian mirror this machine's apt is set to, if it is set to one.
host_mirror() {
    command -v apt-get >/dev/null || return 0
    apt-get indextargets --format '$(REPO_URI)' 'Origin: Debian' 'Label: Debian' 2>/dev/null | head -n 1
}
