#!/bin/sh
# Enters the private root without bwrap, as root, in a mount namespace of its own. Takes the bwrap options that enter_root writes;
# HEADSTOCK_VIEW is an empty folder, on which the view is laid out.
set -eu
view=$HEADSTOCK_VIEW
unset HEADSTOCK_VIEW
folder=/
mkdir -p -- "$view"
mount -t tmpfs -o mode=755 tmpfs "$view"
while [ $# -gt 0 ]; do
    case $1 in
        --bind | --dev-bind | --ro-bind)
            if [ -d "$2" ]; then mkdir -p -- "$view$3"; else mkdir -p -- "$view${3%/*}"; [ -e "$view$3" ] || : >"$view$3"; fi
            mount --rbind -- "$2" "$view$3"
            [ "$1" != --ro-bind ] || mount -o remount,bind,ro -- "$view$3"
            shift 3 ;;
        --symlink) ln -s -- "$2" "$view$3"; shift 3 ;;
        --proc) mkdir -p -- "$view$2"; mount -t proc proc "$view$2"; shift 2 ;;
        --tmpfs) mkdir -p -- "$view$2"; mount -t tmpfs -o mode=755 tmpfs "$view$2"; shift 2 ;;
        --remount-ro) mount -o remount,ro -- "$view${2%/}"; shift 2 ;;
        --hostname) hostname "$2"; shift 2 ;;
        --chdir) folder=$2; shift 2 ;;
        *) break ;;
    esac
done
exec chroot "$view" /bin/sh -c 'cd -- "$1" && shift && exec "$@"' sh "$folder" "$@"
