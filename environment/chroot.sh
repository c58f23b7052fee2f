#!/bin/sh
# Enters the private root without bwrap, as root, in a mount namespace of its own. Takes the bwrap options that enter_root writes.
set -eu
view=
folder=/
while [ $# -gt 0 ]; do
    case $1 in
        --bind | --dev-bind | --ro-bind)
            if [ "$3" = / ]; then
                view=$2
                mount --bind -- "$view" "$view"
            else
                if [ -d "$2" ]; then mkdir -p -- "$view$3"; else [ -e "$view$3" ] || : >"$view$3"; fi
                mount --rbind -- "$2" "$view$3"
            fi
            shift 3 ;;
        --proc) mount -t proc proc "$view$2"; shift 2 ;;
        --tmpfs) mount -t tmpfs -o mode=755 tmpfs "$view$2"; shift 2 ;;
        --hostname) hostname "$2"; shift 2 ;;
        --chdir) folder=$2; shift 2 ;;
        *) break ;;
    esac
done
exec chroot "$view" /bin/sh -c 'cd -- "$1" && shift && exec "$@"' sh "$folder" "$@"
