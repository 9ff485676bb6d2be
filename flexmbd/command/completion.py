"""`flexmbd completion bash`: a script that completes subcommands, options and names in a shell."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol

from flexmbd.command.terminal import Parser, print_line
from flexmbd.errors import FlexmbdError

_SHELLS = ("bash", "zsh")
_FUNCTION = """\
_flexmbd() {{
    local word="${{COMP_WORDS[COMP_CWORD]}}" before="${{COMP_WORDS[COMP_CWORD-1]}}" known=""
    COMPREPLY=()
    if [ "$COMP_CWORD" -eq 1 ]; then
        COMPREPLY=($(compgen -W "{subcommands} --help --version" -- "$word"))
        return
    fi
    case "${{COMP_WORDS[1]}} $before" in
{values}
    esac
    if [ -z "$known" ]; then
        case "${{COMP_WORDS[1]}}" in
{options}
        esac
        case "$word" in
            -*) ;;
            *) COMPREPLY=($(compgen -f -- "$word")); known="$names" ;;
        esac
    fi
    COMPREPLY+=($(compgen -W "$known" -- "$word"))
}}
complete -o filenames -F _flexmbd flexmbd
"""
_ZSH = "autoload -U +X bashcompinit && bashcompinit\n"
_EXAMPLES = """\
examples:
  eval "$(flexmbd completion bash)"                 in ~/.bashrc
  flexmbd completion bash > ~/.local/share/bash-completion/completions/flexmbd
  eval "$(flexmbd completion zsh)"                  in ~/.zshrc
"""


class Described(Protocol):
    """A subcommand: its name, and what gives a parser its arguments."""

    @property
    def name(self) -> str:
        """The word after `flexmbd`."""

    def describe(self, parser: argparse.ArgumentParser) -> None:
        """Give a parser the subcommand's arguments."""


def describe(parser: argparse.ArgumentParser) -> None:
    """Give the subcommand's parser its arguments."""
    parser.description = "Print a script that completes subcommands, options, formats and files in a shell."
    parser.epilog = _EXAMPLES
    parser.add_argument("shell", choices=_SHELLS, help="whose script")
    parser.set_defaults(run=completion)


def completion(arguments: argparse.Namespace) -> int:
    """Print the script. Not collective.

    Args:
        arguments: the shell, and as `subcommands` those that the script completes.
    """
    print_line(script(arguments.shell, arguments.subcommands).rstrip("\n"))
    return 0


def script(shell: str, subcommands: Iterable[Described]) -> str:
    """The script of a shell, from the parsers of all subcommands."""
    names_of_all: list[str] = []
    options: list[str] = []
    values: list[str] = []
    for one in subcommands:
        names_of_all.append(one.name)
        parser = Parser(prog=f"flexmbd {one.name}")
        try:
            one.describe(parser)
        except FlexmbdError:  # what it needs is not installed
            continue
        names = " ".join([*parser.positional_choices(), *_words_of(one.name)])
        known = " ".join(parser.long_options())
        options.append(f'            {one.name}) known="{known}"; local names="{names}" ;;')
        chosen = {**parser.choices_of_options(), **_names_of(one.name)}
        values += [f'        "{one.name} {word}") known="{" ".join(all_of)}" ;;' for word, all_of in chosen.items()]
    found = _FUNCTION.format(
        subcommands=" ".join(names_of_all), values="\n".join(values), options="\n".join(options)
    )
    return found if shell == "bash" else _ZSH + found


def _words_of(subcommand: str) -> Sequence[str]:
    """Names that may follow a subcommand itself."""
    if subcommand == "example":
        from flexmbd.command.examples import EXAMPLES

        return list(EXAMPLES)
    return ()


def _names_of(subcommand: str) -> Mapping[str, Sequence[str]]:
    """What may follow options whose values are names, but also files of one's own."""
    if subcommand in ("export", "convert"):
        from flexmbd.export import FORMATS

        formats = [one.name for one in FORMATS]
        return {"--to": formats} if subcommand == "export" else {"--to": formats, "--from": formats}
    return {}
