# Sourced by ../headstock: where roots, compiled forms and bytecode are kept, and whether what lies there is believed.

# Without HOME the one of the account; MPI and other libraries need the variable too.
choose_home() {
    [ -z "${HOME:-}" ] || return 0
    HOME=$({ getent passwd "$me" || grep "^[^:]*:[^:]*:$me:" /etc/passwd; } 2>/dev/null | head -n 1 | cut -d : -f 6)
    [ -n "$HOME" ] || HOME=${XDG_CACHE_HOME:-}
    [ -n "$HOME" ] || fail "HOME is not set and this account has no home folder: name a folder of your own with XDG_CACHE_HOME=/path"
    export HOME
}

# The user's cache folder; where that cannot be written (a container started with --user, a read-only home) one of this user's own
# below the temporary folder. Others may make a folder of that name first, so it is used only when it is ours.
choose_cache() {
    [ -z "$dry_run" ] || return 0
    if ! mkdir -p -- "$cache" 2>/dev/null || [ ! -w "$cache" ]; then
        spare=${TMPDIR:-/tmp}/headstock-cache-$me
        mkdir -m 700 -- "$spare" 2>/dev/null || :
        [ -d "$spare" ] && [ ! -L "$spare" ] && [ -O "$spare" ] || fail "neither $cache nor $spare can be used: name a folder with XDG_CACHE_HOME=/path"
        say "$cache cannot be written; what is kept goes to $spare"
        export XDG_CACHE_HOME="$spare"
        cache=$spare/headstock
        mkdir -p -- "$cache"
    fi
    require_private
}

# Programs and compiled code of the cache are run, so nobody but this account and root may own or write it, what it holds at its top,
# or a folder on the way to it. A folder with the sticky bit (as /tmp) on the way keeps what is ours.
require_private() {
    way=
    for path in "$cache" "$(cd -P -- "$cache" && pwd -P)"; do
        while [ "$path" != / ]; do
            path=${path%/*} path=${path:-/}
            case "$newline$way" in *"$newline$path$newline"*) ;; *) way=$way$path$newline ;; esac
        done
    done
    kept=$cache$newline
    for path in "$cache"/* ; do [ ! -e "$path" ] || kept=$kept$path$newline; done
    alien=$(IFS=$newline; set -f; stat -L -c '%u %a %G %n' -- $kept // $way 2>/dev/null | foreign_paths)
    [ -z "$alien" ] || fail "${alien%%
*}: nothing in $cache is used. Give it to this account and chmod go-w it, or name another folder with XDG_CACHE_HOME=/path"
}

# Of lines "OWNER MODE GROUP PATH" a sentence about each path that others own or may write; behind // come folders on the way.
foreign_paths() {
    place=kept
    while IFS=' ' read -r owner mode group path; do
        if [ "$path" = // ]; then place=way; continue; fi
        if [ "$owner" != "$me" ] && [ "$owner" != 0 ] && ! unmapped "$owner"; then
            echo "$path belongs to the account with number $owner"
        fi
        # octal digits: sticky and set-id bits where there are four, owner, group, others
        bits=0 digits=$mode
        case $mode in ????) bits=${mode%???} digits=${mode#?} ;; esac
        case $place$bits in way[1357]) continue ;; esac
        # a group of the account's own name has no other members where accounts get one each
        case $digits in
            ??[2367]) echo "$path can be written by everybody" ;;
            ?[2367]?) [ "$group" = "$(id -un)" ] || echo "$path can be written by the group $group" ;;
        esac
    done
}

# In a user namespace all accounts without a number of their own there, root among them, look like this one.
unmapped() {
    read -r inner outer count </proc/self/uid_map 2>/dev/null || return 1
    [ "$count" != 4294967295 ] && [ "$1" = "$(cat /proc/sys/kernel/overflowuid)" ]
}
