"""`ldt completion`: names in the shell by the tabulator key; what they are completed from.

Commands, options and choices come from click; machines, models, detectors and effects from where
they are declared; wherever nothing of that kind fits, files are offered.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable
from typing import Any

import click
from click.shell_completion import (
    BashComplete,
    CompletionItem,
    FishComplete,
    ShellComplete,
    ZshComplete,
    add_completion_class,
    get_completion_class,
)

from ldt_core.cli.spelling import SuggestingChoice

VARIABLE = "_LDT_COMPLETE"  # by which the shell's function asks the program
SHELLS = ("bash", "zsh", "fish")

#: Kind of a parameter → where its values are listed; imported when they are asked for.
_KNOWN = {
    "machine": "msgs_config:machine_names",
    "model": "ldt_core.models:MODELS.names",
    "detector": "ldt_core.detectors:DETECTORS.names",
    "effect": "ldt_core.effects:EFFECTS.names",
    "page": "ldt_core.docs:names",
}

Completer = Callable[[click.Context, click.Parameter, str], list[str]]


def known(kind: str) -> Completer | None:
    """A completer for the values of an option, None when nothing is known of them."""
    if kind not in _KNOWN:
        return None
    return _completer(lambda: pkgutil.resolve_name(_KNOWN[kind])())


def among(names: list[str]) -> Completer:
    """A completer for one of these names."""
    return _completer(lambda: names)


def _completer(listed: Callable[[], list[str]]) -> Completer:
    def complete(_context: click.Context, _parameter: click.Parameter, begun: str) -> list[str]:
        return [name for name in listed() if name.startswith(begun)]

    return complete


class _OrFiles(ShellComplete):
    """Offers files where nothing else fits, as shells do by themselves."""

    def get_completions(self, args: list[str], incomplete: str) -> list[CompletionItem[Any]]:
        """As click's, or files."""
        found = super().get_completions(args, incomplete)
        return found or [CompletionItem(incomplete, type="file")]


class _Bash(_OrFiles, BashComplete):
    pass


class _Zsh(_OrFiles, ZshComplete):
    pass


class _Fish(_OrFiles, FishComplete):
    pass


def register() -> None:
    """Let click answer shells by our classes."""
    for kind in (_Bash, _Zsh, _Fish):
        add_completion_class(kind)


@click.command("completion", short_help="Tab completion of commands, options and names.")
@click.argument("shell", type=SuggestingChoice(SHELLS), metavar="SHELL")
def command(shell: str) -> None:
    """Print the script for tab completion of commands, options and names in SHELL.

    For bash put eval "$(ldt completion bash)" into ~/.bashrc, for zsh the same with zsh into
    ~/.zshrc; for fish run ldt completion fish > ~/.config/fish/completions/ldt.fish.

    Example: eval "$(ldt completion bash)"
    """
    register()
    kind = get_completion_class(shell)
    assert kind is not None
    root = click.get_current_context().find_root().command
    click.echo(kind(root, {}, "ldt", VARIABLE).source())
