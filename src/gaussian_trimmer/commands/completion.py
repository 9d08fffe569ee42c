"""`gaussian-trimmer completion`: a script by which bash or zsh completes commands, options and their choices."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Annotated, Literal, cast

from gaussian_trimmer.commands import COMMANDS, kind_of
from gaussian_trimmer.options import Positional, arg, options_of

_SCRIPT = """\
_gaussian_trimmer() {{
    local current="${{COMP_WORDS[COMP_CWORD]}}" previous="${{COMP_WORDS[COMP_CWORD-1]}}" options=""
    COMPREPLY=()
    if [ "$COMP_CWORD" -eq 1 ]; then
        COMPREPLY=($(compgen -W "{commands}" -- "$current"))
        return
    fi
    case "${{COMP_WORDS[1]}} ${{COMP_WORDS[2]}}" in
{cases}
    esac
    case "$previous" in
{choices}
    esac
    case "$current" in
        -*) COMPREPLY=($(compgen -W "$options --help --help-all" -- "$current")) ;;
    esac
}}
complete -o default -F _gaussian_trimmer gaussian-trimmer
"""
_FOR_ZSH = "autoload -U +X compinit && compinit\nautoload -U +X bashcompinit && bashcompinit\n"


@dataclass(frozen=True)
class Completion:
    """Print a script that makes the shell complete commands, options and their choices.

    Bash: add `source <(gaussian-trimmer completion bash)` to ~/.bashrc. Zsh: the same with zsh, to ~/.zshrc.
    """

    shell: Annotated[Positional[Literal["bash", "zsh"]], arg(metavar="{bash,zsh}")]
    """The shell."""

    def run(self) -> None:
        """Print the script."""
        print((_FOR_ZSH if self.shell == "zsh" else "") + script(), end="")


def script() -> str:
    """The script for bash, which zsh understands, too."""
    cases, choices = [], dict[str, str]()
    for name in sorted(COMMANDS, key=len, reverse=True):  # those of two words first
        known = options_of(cast(Hashable, kind_of(name)))
        options = [option for option in known if not (option.note.positional or option.note.order)]
        flags = " ".join(flag for option in options for flag in option.flags)
        cases.append(f'        "{name}{"" if " " in name else " "}"*) options="{flags}" ;;')
        choices |= {option.flags[0]: " ".join(option.choices) for option in options if option.choices}
    lines = [
        f'        {flag}) COMPREPLY=($(compgen -W "{words}" -- "$current")); return ;;'
        for flag, words in choices.items()
    ]
    firsts = " ".join(dict.fromkeys(name.split()[0] for name in COMMANDS))
    return _SCRIPT.format(commands=f"{firsts} --help --version", cases="\n".join(cases), choices="\n".join(lines))
