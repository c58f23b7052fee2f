# Sourced by ../headstock: runs a command inside the private root, where the host's folders keep their names.

# Top folders that belong to the root; every other one is the host's.
system_folder() {
    case $1 in bin | boot | dev | etc | lib | lib32 | lib64 | libx32 | proc | run | sbin | sys | usr | var | lost+found) return 0 ;; esac
    return 1
}

# nearest_folder PATH: the folder to bind so that PATH can be read or made: itself, its parent, or the nearest one that exists.
nearest_folder() {
    folder=$1
    case $folder in /*) ;; *) folder=$PWD/$folder ;; esac
    while [ ! -d "$folder" ]; do folder=$(dirname -- "$folder"); done
    case $folder in */../* | */.. | */. | */./*) folder=$(cd -- "$folder" && pwd) ;; esac
    [ "$folder" = / ] || folder=${folder%/}
    printf '%s\n' "$folder"
}

# out_of_sight FOLDER: whether FOLDER (absolute) lies in one of the root's own folders and is none of them itself.
out_of_sight() {
    case $1 in /tmp/* | /proc/* | /sys/* | /dev/*) return 1 ;; esac
    top=${1#/} top=${top%%/*}
    rest=${1#/"$top"}
    [ -n "$top" ] && [ -n "$rest" ] && system_folder "$top" || return 1
    # the system's own programs and settings stay the root's
    case $1 in /usr/bin | /usr/sbin | /usr/lib* | /usr/share | /usr/share/* | /usr/include | /usr/local | /usr/local/bin | /etc/* | /var/lib | /var/cache | /run/lock) return 1 ;; esac
    return 0
}

# enter_root COMMAND ...: words that name paths in the root's own folders are bound one by one.
enter_root() {
    for word in "$project" "$cache" "$PWD" "${HOME:-/}" "${TMPDIR:-/tmp}" "$@"; do
        case $word in
            -*=*) word=${word#*=} ;;
            -*) continue ;;
        esac
        case $word in /* | */* | ..) ;; *) continue ;; esac
        case $word in /usr/bin/* | /bin/*) continue ;; esac
        folder=$(nearest_folder "$word")
        for name in "$folder" "$(readlink -f -- "$folder")"; do
            if out_of_sight "$name"; then set -- --bind "$name" "$name" "$@"; fi
        done
    done
    for certificate in "${PIP_CERT:-}" "${SSL_CERT_FILE:-}" "${REQUESTS_CA_BUNDLE:-}" /etc/ssl/certs/ca-certificates.crt \
        /etc/pip.conf /etc/resolv.conf /etc/hosts /etc/passwd /etc/group; do
        if [ -f "$certificate" ]; then set -- --ro-bind "$(readlink -f -- "$certificate")" "$certificate" "$@"; fi
    done
    for top in /*; do
        if [ -d "$top" ] && ! system_folder "${top#/}"; then set -- --bind "$(readlink -f -- "$top")" "$top" "$@"; fi
    done
    # the host's own /proc: a fresh one lacks files in some containers
    set -- --bind "$root" / --dev-bind /dev /dev --dev-bind /proc /proc --ro-bind /sys /sys --bind /var/tmp /var/tmp ${own_places:-} "$@"
    if [ -n "$dry_run" ]; then printf '%s\n' bwrap --chdir "$PWD" "$@"; return; fi
    choose_entrance
    # no exec: the program ends with this shell, and not when the shell that started this one closes
    case $entrance in
        bwrap) PATH=$inner_path "$(command -v bwrap)" --die-with-parent --chdir "$PWD" "$@" ;;
        slurm) enter_slurm_root "$@" ;;
        chroot) PATH=$inner_path unshare --mount --propagation private sh "$project/environment/chroot.sh" --chdir "$PWD" "$@" ;;
    esac
}

choose_entrance() {
    entrance=${HEADSTOCK_ENTER:-}
    [ -z "$entrance" ] || return 0
    if [ -e "$cache/entrance" ] && read -r boot entrance <"$cache/entrance" && [ "$boot" = "$(boot_id)" ]; then return; fi
    if bwrap --bind "$root" / --dev-bind /dev /dev --dev-bind /proc /proc /bin/true 2>/dev/null; then
        entrance=bwrap
    elif [ "$(id -u)" = 0 ] && unshare --mount true 2>/dev/null; then
        entrance=chroot
    else
        bwrap --bind "$root" / --dev-bind /dev /dev --dev-bind /proc /proc /bin/true || :
        fail "this machine lets neither bwrap nor chroot make a file system view. In a container: start it with --privileged. \
Elsewhere: allow user namespaces (sysctl kernel.unprivileged_userns_clone=1, kernel.apparmor_restrict_unprivileged_userns=0)"
    fi
    printf '%s %s\n' "$(boot_id)" "$entrance" >"$cache/entrance.$$"
    mv -f -- "$cache/entrance.$$" "$cache/entrance"
}

boot_id() { cat /proc/sys/kernel/random/boot_id 2>/dev/null || echo unknown; }
