"""Scripts that teach a shell to complete ``headstock`` commands, options and file names with the
Tab key.

They ask the command as it was typed, so that ``./headstock`` completes from its own checkout and
needs no place on the PATH. What they send and get is click's protocol (click.shell_completion), in
the order of words that typer reads.
"""

VARIABLE = "_HEADSTOCK_COMPLETE"
BASH = """\
_headstock_completion() {
    local IFS=$'\\n' response answer kind value
    response=$(env COMP_WORDS="${COMP_WORDS[*]}" COMP_CWORD="$COMP_CWORD" VARIABLE=complete_bash "${1/#\\~/$HOME}" 2>/dev/null)
    COMPREPLY=()
    for answer in $response; do
        IFS=',' read -r kind value <<< "$answer"
        case $kind in
            dir) compopt -o dirnames ;;
            file) compopt -o default ;;
            plain) COMPREPLY+=("$value") ;;
        esac
    done
}
complete -o nosort -F _headstock_completion headstock
"""
ZSH = """\
#compdef headstock
_headstock_completion() {
    local -a plain described response
    local kind value help
    response=("${(@f)$(env COMP_WORDS="${words[*]}" COMP_CWORD=$((CURRENT-1)) VARIABLE=complete_zsh ${~words[1]} 2>/dev/null)}")
    for kind value help in ${response}; do
        case $kind in
            plain) if [[ $help == _ ]]; then plain+=("$value"); else described+=("${value//:/\\\\:}:$help"); fi ;;
            dir) _path_files -/ ;;
            file) _path_files -f ;;
        esac
    done
    if [[ -n $described ]]; then _describe -V unsorted described -U; fi
    if [[ -n $plain ]]; then compadd -U -V unsorted -a plain; fi
}
if [[ $zsh_eval_context[-1] == loadautofunc ]]; then
    _headstock_completion "$@"
else
    compdef _headstock_completion headstock
fi
"""
FISH = """\
function _headstock_completion
    set -l words (commandline -opc)
    set -l program (string replace -r '^~' $HOME -- $words[1])
    for answer in (env COMP_WORDS=(commandline -cp | string collect) COMP_CWORD=(commandline -t | string collect) \\
            VARIABLE=complete_fish $program 2>/dev/null)
        set -l parts (string split -m 1 ',' -- $answer)
        switch $parts[1]
            case dir
                __fish_complete_directories (commandline -t)
            case file
                __fish_complete_path (commandline -t)
            case plain
                echo $parts[2]
        end
    end
end
complete --no-files --command headstock --arguments '(_headstock_completion)'
"""
SCRIPTS = {
    shell: text.replace("VARIABLE", VARIABLE)
    for shell, text in (("bash", BASH), ("zsh", ZSH), ("fish", FISH))
}
