# Runs a command that starts MPI ranks, and ends with the exit code that rank 0 leaves in a file: mpirun takes any code but 0 for a
# crash of that rank and prints a page about it.
HEADSTOCK_VERDICT=$(mktemp) || exit 1
export HEADSTOCK_VERDICT
# who ends this shell ends the ranks
if command -v setpriv >/dev/null; then set -- setpriv --pdeathsig KILL "$@"; fi
code=
"$@" || code=$?
[ -n "$code" ] || read -r code <"$HEADSTOCK_VERDICT"
rm -f -- "$HEADSTOCK_VERDICT"
exit "${code:-1}"
