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

# foreign_places WORD ...: the folders in the root's own that these words name, one a line, under their names and with links resolved.
foreign_places() {
    for word; do
        case $word in
            *"$newline"*) continue ;;
            -[!-]/*) word=${word#-?} ;;
            -*=*) word=${word#*=} ;;
            -*) continue ;;
        esac
        case $word in /* | */* | ..) ;; *) continue ;; esac
        case $word in /usr/bin/* | /bin/*) continue ;; esac
        folder=$(nearest_folder "$word")
        for name in "$folder" "$(cd -P -- "$folder" && pwd -P)"; do
            if out_of_sight "$name"; then printf '%s\n' "$name"; fi
        done
    done
}

# The nearest folder of the root above PATH where PATH is none itself; the root is read-only, so that folder has to be laid out anew.
holder() {
    above=$1
    [ ! -d "$root$above" ] || return 0
    while [ -n "$above" ] && [ ! -d "$root$above" ]; do above=${above%/*}; done
    case $above in /usr | /usr/*) printf '%s\n' "$above" ;; esac
}

# bwrap would look for the target of an absolute link in the root
source_of() { if [ -L "$1" ]; then readlink -f -- "$1"; else printf '%s\n' "$1"; fi; }

# enter_root COMMAND ...: the root's folders read-only, the host's with their names, and nothing else that could be written: what is
# written anywhere lies on the host or is refused. Options come before COMMAND, the last ones first.
enter_root() {
    foreign=$(foreign_places "$project" "$cache" "$PWD" "${HOME:-/}" "${TMPDIR:-/tmp}" "${HEADSTOCK_STORE:-}" "${XDG_RUNTIME_DIR:-}" \
        "${MPLCONFIGDIR:-}" "${PMIX_SERVER_TMPDIR:-}" "$@")
    holders=
    set -f
    IFS=$newline
    for name in $foreign; do
        found=$(holder "$name")
        case $newline$holders in *"$newline$found$newline"*) ;; *) holders=$holders$found$newline ;; esac
    done
    for name in $holders ${writable_run:-/run} /var /; do set -- --remount-ro "$name" "$@"; done
    for name in $foreign; do set -- --bind "$name" "$name" "$@"; done
    set +f
    for name in $holders; do
        for part in "$root$name"/*; do [ ! -e "$part" ] || set -- --ro-bind "$part" "$name/${part##*/}" "$@"; done
        set -- --tmpfs "$name" "$@"
    done
    unset IFS
    for setting in PIP_CERT SSL_CERT_FILE REQUESTS_CA_BUNDLE PIP_CONFIG_FILE; do
        eval "file=\${$setting:-}"
        if [ -z "$file" ] && [ $setting = PIP_CONFIG_FILE ]; then file=/etc/pip.conf; fi
        if [ -f "$file" ]; then
            set -- --ro-bind "$(readlink -f -- "$file")" "/run/headstock/$setting" "$@"
            export "$setting=/run/headstock/$setting"
        fi
    done
    for file in /etc/ssl/certs/ca-certificates.crt /etc/resolv.conf /etc/hosts /etc/passwd /etc/group; do
        if [ -f "$file" ] && [ -e "$root$file" ]; then set -- --ro-bind "$(source_of "$file")" "$file" "$@"; fi
    done
    for top in /* /.[!.]*; do
        if [ -e "$top" ] && ! system_folder "${top#/}"; then set -- --bind "$(source_of "$top")" "$top" "$@"; fi
    done
    [ ! -d /var/tmp ] || set -- --bind /var/tmp /var/tmp "$@"
    # the host's own /proc: a fresh one lacks files in some containers
    set -- --dev-bind /dev /dev --dev-bind /proc /proc --ro-bind /sys /sys --tmpfs /run --tmpfs /var ${own_places:-} "$@"
    for top in usr etc bin sbin lib lib32 lib64 libx32; do
        if [ -L "$root/$top" ]; then
            set -- --symlink "$(readlink "$root/$top")" "/$top" "$@"
        elif [ -d "$root/$top" ] || [ $top = usr ] || [ $top = etc ]; then
            set -- --ro-bind "$root/$top" "/$top" "$@"
        fi
    done
    if [ -n "$dry_run" ]; then printf '%s\n' bwrap --chdir "$PWD" "$@"; return; fi
    choose_entrance
    # no exec: the program ends with this shell, and not when the shell that started this one closes
    case $entrance in
        bwrap) PATH=$inner_path "$(command -v bwrap)" --die-with-parent --chdir "$PWD" "$@" ;;
        slurm) enter_slurm_root "$@" ;;
        chroot) PATH=$inner_path HEADSTOCK_VIEW="$cache/view" unshare --mount --propagation private sh "$project/environment/chroot.sh" --chdir "$PWD" "$@" ;;
    esac
}

choose_entrance() {
    entrance=${HEADSTOCK_ENTER:-}
    [ -z "$entrance" ] || return 0
    boot_id=unknown
    [ ! -r "$boot_file" ] || read -r boot_id <"$boot_file"
    if [ -e "$cache/entrance" ] && read -r boot entrance <"$cache/entrance" && [ "$boot" = "$boot_id" ]; then return; fi
    if bwrap --bind "$root" / --dev-bind /dev /dev --dev-bind /proc /proc /bin/true 2>/dev/null; then
        entrance=bwrap
    elif [ "$me" = 0 ] && unshare --mount true 2>/dev/null; then
        entrance=chroot
    else
        bwrap --bind "$root" / --dev-bind /dev /dev --dev-bind /proc /proc /bin/true || :
        fail "this machine lets neither bwrap nor chroot make a file system view. In a container: start it with --privileged. \
Elsewhere: allow user namespaces (sysctl kernel.unprivileged_userns_clone=1, kernel.apparmor_restrict_unprivileged_userns=0)"
    fi
    printf '%s %s\n' "$boot_id" "$entrance" >"$cache/entrance.$$"
    mv -f -- "$cache/entrance.$$" "$cache/entrance"
}

boot_file=/proc/sys/kernel/random/boot_id
