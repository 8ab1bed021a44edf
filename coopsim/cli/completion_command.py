"""`coopsim completion`: a script by which bash or zsh completes commands, options and names."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping

from coopsim.cli.arguments import Command
from coopsim.cli.listing import listing

_SHELLS = ("bash", "zsh")

_VALUES: Mapping[str, str] = {
    "--policies": "policies",
    "--policy": "policies",
    "--alone": "policies",
    "--sharing": "policies",
    "--environments": "environments",
    "--environment": "environments",
    "--detector": "detectors",
    "--metrics": "metrics",
    "--preset": "presets",
    "train": "recipes",
    "export": "export formats",
    "record": "environments",
}
"""Kinds of names that follow an option or a command."""

_SCRIPT = """\
_coopsim() {{
  local word="${{COMP_WORDS[COMP_CWORD]}}" before="${{COMP_WORDS[COMP_CWORD-1]}}" words="" begun=""
  case "$word" in *,*) begun="${{word%,*}},";; esac
  case "$before" in
{values}
  esac
  [ "$COMP_CWORD" = 1 ] && words="{commands}"
  case "$word,$words" in
    --*|*,) case "${{COMP_WORDS[1]}}" in
{options}
    esac;;
  esac
  COMPREPLY=($(compgen -P "$begun" -W "$words" -- "${{word##*,}}"))
}}
complete -o default -F _coopsim coopsim
"""


def _add_completion(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=_SHELLS, metavar="SHELL", help="bash or zsh")


def _run_completion(options: argparse.Namespace) -> int:
    if options.shell == "zsh":
        print("autoload -U +X bashcompinit && bashcompinit")
    commands = _subparsers(options.parser)
    values = [_case(before, " ".join(known)) for before, known in _values(commands).items()]
    flags = [_case(name, " ".join(_flags(parser))) for name, parser in commands.items()]
    script = _SCRIPT.format(values="\n".join(values), commands=" ".join(commands), options="\n".join(flags))
    print(script, end="")
    return 0


def _case(pattern: str, words: str) -> str:
    return f'    {pattern}) words="{words}";;'


def _values(commands: Mapping[str, argparse.ArgumentParser]) -> dict[str, list[str]]:
    """Return the names that follow an option or a command: those of a kind, or an option's choices."""
    kinds = listing()
    found = {before: [entry["name"] for entry in kinds[kind]()] for before, kind in _VALUES.items()}
    found["list"] = [kind.replace(" ", "-") for kind in kinds]
    found["completion"] = list(_SHELLS)
    for parser in commands.values():
        for action in parser._actions:
            for option in action.option_strings if action.choices else ():
                found[option] = [str(choice) for choice in action.choices or ()]
    return found


def _subparsers(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    found = next(each for each in parser._actions if isinstance(each, argparse._SubParsersAction))
    return dict(found.choices)


def _flags(parser: argparse.ArgumentParser) -> Iterator[str]:
    """Yield the options of a command and of its own sub-commands, without old names."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, each in action.choices.items():
                yield from (name, *_flags(each))
        elif action.help != argparse.SUPPRESS:
            yield from (option for option in action.option_strings if option.startswith("--"))


COMPLETION = Command(
    "print a script that completes commands, options and names in bash or zsh",
    _add_completion,
    _run_completion,
    (
        "coopsim completion bash > ~/.local/share/bash-completion/completions/coopsim",
        "coopsim completion zsh >> ~/.zshrc",
    ),
)
