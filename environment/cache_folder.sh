# Sourced by ../headstock: where roots, compiled forms and bytecode are kept.

# The user's cache folder; where that cannot be written (a container started with --user, a read-only home) one of this user's own
# below the temporary folder. Others may make a folder of that name first, so it is used only when it is ours.
choose_cache() {
    [ -z "$dry_run" ] || return 0
    if mkdir -p -- "$cache" 2>/dev/null && [ -w "$cache" ]; then return; fi
    spare=${TMPDIR:-/tmp}/headstock-cache-$(id -u)
    mkdir -m 700 -- "$spare" 2>/dev/null || :
    [ -d "$spare" ] && [ ! -L "$spare" ] && [ -O "$spare" ] || fail "neither $cache nor $spare can be used: name a folder with XDG_CACHE_HOME=/path"
    say "$cache cannot be written; what is kept goes to $spare"
    export XDG_CACHE_HOME="$spare"
    cache=$spare/headstock
    mkdir -p -- "$cache"
}
