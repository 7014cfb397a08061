"""What was meant by a name that does not exist: commands, options, choices."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import click

from ldt_core.base.errors import MOST_BESIDE_NEAREST, OptionError, did_you_mean, most_alike
from ldt_core.cli.outputs import FORMER

HELP = ["-h", "--help"]
#: Command and option that people expect of it → what to do instead, where no spelling is near.
INSTEAD = {
    **{
        (command, "--duration"): (
            "how long an experiment lasts stands in the machine file (ldt docs machine). How many "
            "there are: --experiments"
        )
        for command in ("run", "up", "simulate")
    },
    ("identify", "--machine"): (
        "identify makes a machine file of recordings alone. To fit a file that you have: "
        "ldt calibrate RECORDING --machine FILE --out FITTED.yaml"
    ),
}


#: Options that name a file or folder; an empty name is a variable of a script that nobody has set.
PLACES = (
    "-o",
    "--out",
    "--bag",
    "--with",
    "--play",
    "--settings",
    "--resume",
    "--figure",
    "--next",
)
#: Those of which an empty name says something else, or is refused by itself.
OTHER_PLACES = ("--machine", "--key", "--secure")


def nameless(arguments: Sequence[str]) -> str:
    """An option whose file or folder has an empty name; "" if there is none.

    >>> nameless(["predict", "bag", "--with", "", "--out", "x"]), nameless(["run", "--play=bag"])
    ('--with', '')
    """
    alone = [a for a, value in itertools.pairwise(arguments) if value == ""]
    joined = [a[:-1] for a in arguments if a.endswith("=")]
    return next((option for option in (*alone, *joined) if option in PLACES), "")


def refuse_twice(command: click.Command, arguments: Sequence[str]) -> None:
    """Refuse an option that names one file or folder and is typed twice, as if for both.

    Of other options the last one counts, as everywhere: so a script's defaults are overridden.

    Raises:
        OptionError: names it.
    """
    flags = {flag for p in command.params for flag in p.opts}
    present = [a if a in flags else FORMER.get(a, a) for a in arguments]
    context = click.Context(command, resilient_parsing=True)
    _, _, typed = command.make_parser(context).parse_args(present)
    for option, count in Counter(typed).items():
        place = isinstance(option, click.Option) and {*option.opts} & {*PLACES, *OTHER_PLACES}
        if place and not option.multiple and count > 1:
            raise OptionError(option.opts[-1], "one file or folder", f"{count} of them")


def nearest(name: str, known: Iterable[str]) -> str | None:
    """The name that begins so, if there is one only, else the most similar one, if any is.

    >>> nearest("--exp", ["--experiments", "--help", "--error-threshold"])
    '--experiments'
    """
    names = sorted(known)
    begun = [n for n in names if n.startswith(name.replace("_", "-"))]
    if len(begun) == 1:
        return begun[0]
    return most_alike(name, begun or names)


def unknown_option(error: click.NoSuchOption, arguments: Sequence[str]) -> str:
    """A sentence on an option that its command does not have, of what was typed."""
    sentence = f"there is no option {error.option_name!r}"
    if error.ctx is None:
        return sentence
    if way := INSTEAD.get((str(error.ctx.info_name), error.option_name)):
        return f"{sentence}; {way}"
    flags = [
        flag
        for p in error.ctx.command.get_params(error.ctx)
        for flag in (*p.opts, *p.secondary_opts)
    ]
    typed = (a for a in arguments if a.startswith(error.option_name) and f"-{a}" in flags)
    option = next(typed, error.option_name)  # of "-speed" click tells "-s"
    close = nearest(option, (f for f in flags if f.startswith("--")))
    hint = f"; did you mean {close!r}?" if close else ""
    return f"{sentence}{hint} ({error.ctx.command_path} --help lists all)"


def missing(error: click.MissingParameter) -> str:
    """A sentence on an option or argument that its command needs, with the command's example."""
    command = error.ctx.command if error.ctx else None
    wanted = error.param.get_error_hint(error.ctx) if error.param and error.ctx else "one more"
    example = (command.help or "").partition("Example: ")[2].partition("\n")[0] if command else ""
    return f"{wanted} is missing" + (f", as in: {example}" if example else "")


def unusable(error: click.ClickException) -> str:
    """A sentence on a value that is no number, or an argument too many; else click's own."""
    said, context = error.format_message(), getattr(error, "ctx", None)
    if context is None:
        return said
    if isinstance(error, click.BadParameter) and error.param is not None:
        kinds = {
            " is not a valid float.": "a number",
            " is not a valid integer.": "a whole number",
            " is not a valid integer range.": "a whole number",
        }
        for ending, kind in kinds.items():
            if error.message.endswith(ending):
                got = error.message.removesuffix(ending)
                return f"{error.param.opts[-1]}: expected {kind}, without a unit, got {got}"
        name = error.param.opts[-1]
        if isinstance(error.param, click.Argument):
            name = f"{context.command_path} {error.param.human_readable_name}"
        got, between, allowed = error.message.rstrip(".").partition(" is not one of ")
        if between:
            return f"{name}: expected one of {allowed}, got {got}"
        got, between, allowed = error.message.rstrip(".").partition(" is not in the range ")
        if between:
            return f"{name}: expected {_range(allowed)}, got {got}"
    if said.startswith("Got unexpected extra argument"):
        value = said[said.index("(") + 1 : -1]
        options = {name for p in context.command.params for name in p.opts}
        way = f"; a recording follows --play, as in: --play {value}" if "--play" in options else ""
        if value.endswith((".yaml", ".yml")) and "--machine" in options:
            way = f"; a machine file follows --machine, as in: --machine {value}"
        return f"{context.command_path}: too many arguments, {value}{way} (--help lists all)"
    return said


def _range(allowed: str) -> str:
    """Click's range in words.

    >>> _range("0<=x<=65535"), _range("x>=1")
    ('0 to 65535', 'x>=1')
    """
    low, between, high = allowed.partition("<=x<=")
    return f"{low} to {high}" if between else allowed


class SuggestingGroup(click.Group):
    """A group whose answer to an unknown command names those that there are."""

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """As click's, with the nearest command named when there is none; no place comes twice."""
        try:
            name, command, rest = super().resolve_command(ctx, args)
        except click.NoSuchOption:
            raise
        except click.UsageError:
            names = self.list_commands(ctx)
            if args[0] == "help":
                name = "".join(f" {a}" for a in args[1:2] if a in names)
                said = f"there is no command 'help'; expected {ctx.command_path}{name} --help"
                raise click.UsageError(said) from None
            close = nearest(args[0], names)
            hint = f"did you mean {close!r}? " if close else ""
            many = close and len(names) > MOST_BESIDE_NEAREST
            lists = f"({ctx.command_path} --help lists all)"
            told = lists if many else f"commands are {', '.join(names)}"
            raise click.UsageError(f"there is no command {args[0]!r}; {hint}{told}") from None
        if command is not None:
            refuse_twice(command, rest)
        return name, command, rest


class SuggestingChoice(click.Choice[str]):
    """A choice whose answer to an unknown name says which is nearest."""

    def get_invalid_choice_message(self, value: Any, ctx: click.Context | None) -> str:
        """As all other messages of ours."""
        names = (str(choice) for choice in self.choices)
        return f"expected {did_you_mean(str(value), names)}, got {value!r}"
