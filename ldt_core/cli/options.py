"""Options of commands, made from the declared parameters."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import click

import msgs_config
from ldt_core.base.bounded_file import read_bounded
from ldt_core.base.errors import BadInput, OptionError, did_you_mean
from ldt_core.base.plain_yaml import NO_YAML, load_yaml
from ldt_core.base.settings import PRESETS, UNSET, check, flag_of, preset
from ldt_core.cli.completion import among, known
from ldt_core.cli.idle_options import refuse_idle
from ldt_core.cli.outputs import present_spelling
from ldt_core.cli.recorded_machine import machine_of
from ldt_core.cli.spelling import HELP
from ldt_core.cli.terminal import echo, warn

_TYPES = {"integer": click.INT, "double": click.FLOAT, "string": click.STRING}
# Headings in --help by the parameters' groups; those of other groups come first, under Options.
_SECTIONS = {
    "plant": "Simulated machine",
    "model": "Model",
    "detector": "Detector",
    "adaptor": "Adaptor",
    "diagnosis": "Diagnosis and advice",
    "advice": "Diagnosis and advice",
    "player": "Playing a recording",
    "pace": "Pace",
    "stream": "A machine that streams samples",
    "segmenter": "A machine that streams samples",
    "cut": "A machine that streams samples",
    "graph": "Graph",
    "twin": "Graph",
    "security": "Graph",
}


#: Of a file of parameters; one with all of them takes a thousandth.
MOST_BYTES = 1_000_000
MOST_SHOWN = 17  # options that --help lists all of; of more it lists those that are marked so


class Command(click.Command):
    """A command whose help lists its declared parameters by the part that they belong to.

    Of many it lists those that most runs need; `--help-all` lists all. Former spellings go on.
    """

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """As click's, after former spellings."""
        return super().parse_args(
            ctx, present_spelling(args, [f for p in self.params for f in p.opts])
        )

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """As click's, with --help-all where --help does not list all."""
        own = super().get_params(ctx)
        return [*own[:-1], _HELP_ALL if self._many else _HELP_ALL_SAME, own[-1]]

    @property
    def _many(self) -> bool:
        return sum(isinstance(p, click.Option) for p in self.params) > MOST_SHOWN

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """As click's, in sections."""
        every = ctx.meta.get(_EVERY) or not self._many
        sections: dict[str, list[tuple[str, str]]] = {"Options": []}
        for parameter in self.get_params(ctx):
            if isinstance(parameter, click.Argument):
                continue  # the line of usage has it
            shown = every or getattr(parameter, "shown", True)
            if shown and (record := parameter.get_help_record(ctx)):
                heading = getattr(parameter, "section", "Options") if every else "Options"
                sections.setdefault(heading, []).append(record)
        for heading, records in sections.items():
            with formatter.section(heading):
                formatter.write_dl(records)


def _help_all(context: click.Context, _parameter: click.Parameter, asked: bool) -> None:
    if asked and not context.resilient_parsing:
        context.meta[_EVERY] = True
        echo(context.get_help())
        context.exit()


_EVERY = "ldt.every_option"  # key of a context: all are listed
_HELP_ALL, _HELP_ALL_SAME = (
    click.Option(
        ["--help-all"],
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=_help_all,
        help="Show all options in groups, and exit.",
        hidden=hidden,
    )
    for hidden in (False, True)
)


def with_all_help(command: click.Command) -> click.Command:
    """A command with -h, and --help-all where --help lists all as well: the pages tell of both."""
    # click keeps the help option of the context that asks first, be it one without -h.
    command.get_help_option(click.Context(command, help_option_names=HELP))
    if not isinstance(command, Command) and _HELP_ALL_SAME not in command.params:
        command.params.append(_HELP_ALL_SAME)
    if isinstance(command, click.Group):
        for one in command.commands.values():
            with_all_help(one)
    return command


class _Declared(click.Option):
    """The option of a declared parameter."""

    def __init__(self, *arguments: Any, section: str, shown: bool, **attributes: Any) -> None:
        super().__init__(*arguments, **attributes)
        self.section, self.shown = section, shown

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """As click's; of a recording's machine the file is taken that goes with it."""
        arguments = [p for p in ctx.command.params if isinstance(p, click.Argument)]
        if self.name == "machine" and arguments:
            other = "" if arguments[0].required else f", else {self.default}"
            self.show_default = f"that of the recording{other}"
        return super().get_help_record(ctx)


out_option = click.option("-o", "--out", required=True, help="Folder of the new recording.")
namespace_option = click.option(
    "--namespace", default="", help="Namespace of the machine, if there are several."
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")


def serving_options(port: int, what: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """The options of a server, at that port by default; `what` anybody may do who reaches it."""
    options = (
        click.option(
            "--host",
            default="127.0.0.1",
            show_default=True,
            help="Address to serve at. The default is only this computer; 0.0.0.0 lets anybody "
            f"{what}.",
        ),
        click.option(
            "--port",
            type=click.IntRange(0, 65535),
            default=port,
            show_default=True,
            help="Port to serve at; 0 takes any that is free.",
        ),
    )

    def add(function: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(options):
            function = option(function)
        return function

    return add


playback_rate_option = click.option(
    "--rate",
    default="1",
    show_default=True,
    help="Speed at which RECORDING is played relative to real time, or max.",
)
new_file_option = click.option("-o", "--out", required=True, help="Machine file to write.")
judged_option = click.option(
    "--holdout",
    type=float,
    metavar="FRACTION",
    help="Share of the experiments that are held out (a quarter if there are 4 or more).",
)
jobs_option = click.option(
    "--jobs",
    type=click.IntRange(0, 10_000),
    default=0,
    help="Number of processes; by default one per core.",
)
scheduler_option = click.option(
    "--scheduler",
    default="",
    help="Address of a Dask scheduler (tcp://host:port) whose workers do the computing.",
)


def compute_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """--jobs and --scheduler: where it is computed."""
    return jobs_option(scheduler_option(command))


def diagnosis_option(text: str) -> Callable[..., Any]:
    """Decorator: the option of a diagnosis' file, with a help of the command's own."""
    text = f"{text} Only its key effects is used."
    return click.option("--with", "diagnosis", default="", metavar="FILE", help=text)


def warn_of_nothing(diagnosis: str, acting: Sequence[object]) -> None:
    """Say on standard error that a diagnosis adds nothing, where it names no effect."""
    if not acting:
        warn(f"{diagnosis} names no effect, so nothing is added to the machine file")


def parameters(*groups: str) -> Callable[..., Any]:
    """Decorator: an option for each declared parameter of the groups.

    The command receives the checked values of all of them, defaults included, in one mapping named
    `settings`. Of a recording's machine the file is taken that goes with it.
    """
    declared = msgs_config.parameters(*groups)

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def call(**values: Any) -> Any:
            settings = {name: values.pop(name) for name in declared}
            refuse_idle(settings, declared)
            named = [values.get("recording"), *values.get("recordings", ()), settings.get("play")]
            if "machine" in settings and any(named):
                space = values.get("namespace") or settings.get("play_namespace", "")
                played = [recording for recording in named if recording]
                settings["machine"] = machine_of(settings["machine"], played, space)
            return function(settings=settings, **values)

        for name, declaration in reversed(declared.items()):
            _option(name, declaration)(call)
        return _settings_option(call)

    return decorate


def declared_option(name: str) -> Callable[..., Any]:
    """Decorator: the option of one declared parameter, whose value comes under its own name."""
    return _option(name, msgs_config.parameters()[name])


def _settings_option(function: Callable[..., Any]) -> Callable[..., Any]:
    return click.option(
        "--settings",
        "settings_file",
        default="",
        metavar="FILE",
        is_eager=True,
        expose_value=False,
        callback=_take_settings,
        help="File of parameters that replace the defaults, such as the tune.json of ldt tune; "
        "options override it.",
    )(function)


def _take_preset(context: click.Context, _parameter: click.Parameter, name: str) -> None:
    context.default_map = {**preset(name), **(context.default_map or {})}


#: --preset: a configuration by its name; options and files of settings win over it.
preset_option = click.option(
    "--preset",
    default="",
    metavar="NAME",
    is_eager=True,
    expose_value=False,
    callback=_take_preset,
    shell_complete=among(list(PRESETS)),
    help="A named configuration instead of the defaults: "
    f"{', '.join(PRESETS)} (hybrid model, threshold detector, no gate, warning set). Options and "
    "--settings override it.",
)


def _take_settings(context: click.Context, _parameter: click.Parameter, file: str) -> None:
    if file:
        context.default_map = {**(context.default_map or {}), **read_settings(file)}


def read_settings(file: str) -> dict[str, Any]:
    """Parameters by name from a YAML or JSON file; those under its key `settings` if it has one.

    Raises:
        BadInput: the file cannot be read or is no such mapping.
        OptionError: a parameter that does not exist, or a value out of its range.
    """
    try:
        found = load_yaml(read_bounded(file, MOST_BYTES).decode())
    except (OSError, *NO_YAML) as error:
        got = getattr(error, "strerror", None) or "neither YAML nor JSON"
        raise BadInput(file, "a readable file of parameters", got) from error
    if isinstance(found, dict) and "settings" in found:
        found = found["settings"]
    if not isinstance(found, dict):
        raise BadInput(file, "parameters with values", type(found).__name__)
    declared = msgs_config.parameters()
    for name in found:
        if name not in declared:
            raise OptionError(f"{file}, parameter", did_you_mean(str(name), declared), repr(name))
    return {n: check(f"{file}, {n}", value, declared[n]) for n, value in found.items()}


def _option(name: str, declaration: Mapping[str, Any]) -> Callable[..., Any]:
    flag = flag_of(name)
    kind, unit, default = declaration["type"], declaration.get("unit", ""), declaration["default"]
    text = declaration["description"] + (f" [{unit}]" if unit else "")
    choices = [c for c in declaration.get("choices", ()) if c]
    if choices:
        text += f" One of {', '.join(choices)}."
    made: dict[str, Any] = {
        "cls": _Declared,
        "section": _SECTIONS.get(declaration["group"], "Options"),
        "shown": declaration.get("shown", False),
    }
    if kind == "bool":
        both = f"{flag}/--no-{flag[2:]}"
        return click.option(both, name, default=default, show_default=True, help=text, **made)
    many = kind == "string_array"
    completer = among(choices) if choices else known(name)

    def checked(_context: click.Context, _parameter: click.Parameter, value: Any) -> Any:
        return check(flag, list(value) if many else value, declaration)

    alone: dict[str, Any] = {}
    if "without_value" in declaration:
        alone = {"is_flag": False, "flag_value": declaration["without_value"]}
    return click.option(
        *(["-o"] if flag == "--out" else []),
        flag,
        name,
        type=click.STRING if many else _TYPES[kind],
        multiple=many,
        default=default,
        show_default=default not in UNSET,
        callback=checked,
        shell_complete=completer,
        help=text,
        **alone,
        **made,
    )
