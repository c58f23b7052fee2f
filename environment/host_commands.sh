# Sourced by ../headstock: calls Slurm's programs on the host for a program inside the private root, where they are not.

# computes_elsewhere WORDS: whether a command line has --on.
computes_elsewhere() {
    for word; do
        case $word in --on | --on=*) return 0 ;; esac
    done
    return 1
}

# Requests come as names through a named pipe; NAME.words holds a program and its arguments, one a line. The answer is NAME.out,
# NAME.err and, last, NAME.code.
serve_host_commands() {
    while read -r request; do
        set --
        while read -r word; do set -- "$@" "$word"; done <"$host_commands/$request.words"
        code=0
        case $1 in
            sbatch | squeue) "$@" >"$host_commands/$request.out" 2>"$host_commands/$request.err" </dev/null || code=$? ;;
            *) code=126 ;;
        esac
        echo "$code" >"$host_commands/$request.code.new"
        mv -f -- "$host_commands/$request.code.new" "$host_commands/$request.code"
    done <"$host_commands/requests"
    rm -rf -- "$host_commands"
}

start_host_commands() {
    host_commands=$(mktemp -d "${TMPDIR:-/tmp}/headstock-host.XXXXXX")
    mkfifo -- "$host_commands/requests"
    export HEADSTOCK_HOST_COMMANDS="$host_commands"
    serve_host_commands &
    host_server=$!
    # held open by this shell and what it starts: the other side ends when they all have, however they ended
    exec 4>"$host_commands/requests"
    trap 'kill "$host_server" 2>/dev/null; rm -rf -- "$host_commands"' EXIT
    trap 'exit 130' INT
    trap 'exit 143' TERM HUP
}
