"""The command line: discovers commands by entry point and maps errors to exit codes.

A command file holds the arguments, their checks, and the call of the core; nothing runs at import.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import shlex
import sys

import click
from click.shell_completion import CompletionItem

from ldt_core.base import first_compilation, slow_runs
from ldt_core.base.errors import LdtError, reason_of
from ldt_core.base.own_process import kept_alive
from ldt_core.base.registry import entry_points, own_place
from ldt_core.base.stopping import EXIT_CODE, Interrupted, interrupted_by_signals
from ldt_core.cli.completion import VARIABLE, register
from ldt_core.cli.spelling import (
    HELP,
    SuggestingGroup,
    missing,
    nameless,
    unknown_option,
    unusable,
)
from ldt_core.cli.terminal import echo, results_alone, warn

GROUP = "ldt.command"
LONGEST_PLACE = 300  # characters of a file's name in a sentence
NO_THREAD = "can't start new thread"  # Python's own words where memory or threads have run out
NO_EXCEPTION = "raised what is no Exception"
CLICK = click.core.__name__
UNNAMEABLE = (errno.ENAMETOOLONG, errno.ELOOP)  # what no file can be called
# As wide as the terminal up to 100 columns: the options' descriptions are sentences.
CONTEXT = {"help_option_names": HELP, "max_content_width": 100}


#: Headings of `ldt --help` → commands, in the order in which a newcomer needs them.
SECTIONS = {
    "Run": ("demo", "up", "run", "replay", "simulate"),
    "Look": ("info", "report", "watch", "plot", "serve", "export"),
    "Understand": ("diagnose", "effects", "predict", "advise"),
    "Your machine": ("import", "calibrate", "identify", "tune"),
    "Research": ("study", "challenge"),
    "Care": ("docs", "doctor", "rollback", "learning", "security", "completion"),
}


class Commands(SuggestingGroup):
    """Commands by entry point, imported when they are called."""

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """By what they are for; those of other packages come last."""
        names = self.list_commands(ctx)
        others = sorted(set(names).difference(*SECTIONS.values()))
        width = max(map(len, names))
        for heading, members in {**SECTIONS, "Others": others}.items():
            rows = [
                (name.ljust(width), command.get_short_help_str(formatter.width))
                for name in members
                if name in names and (command := self.get_command(ctx, name)) is not None
            ]
            if rows:
                with formatter.section(heading):
                    formatter.write_dl(rows)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of all commands."""
        return sorted({e.name for e in entry_points(GROUP)})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of that name."""
        from ldt_core.cli.options import with_all_help

        for entry in entry_points(GROUP):
            if entry.name == cmd_name:
                return with_all_help(entry.load())
        return None

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Names of commands, without their help: that would import them all, which takes 1 s."""
        if incomplete.startswith("-"):
            return super().shell_complete(ctx, incomplete)
        return [CompletionItem(n) for n in self.list_commands(ctx) if n.startswith(incomplete)]


@click.command(cls=Commands, context_settings=CONTEXT)
@click.version_option(package_name="ldt")
def ldt() -> None:
    """LDT, the learning digital twin.

    A digital twin that runs next to a machine, notices changes, and learns again.

    Start with `ldt demo`, then read `ldt docs start`.

    Example: ldt up --experiments 40 --seed 3
    """


def main(arguments: list[str] | None = None) -> None:
    """Run a command; exit 0: done, 2: bad input, 1: the work itself failed, 130: interrupted."""
    first_compilation.listener = _compiling
    slow_runs.listener = warn
    interrupted_by_signals()
    sys.exit(invoke(ldt, arguments))


def _compiling(ready: int) -> None:
    from ldt_core.cli.progress import show_compiling

    show_compiling(ready)


def invoke(command: click.Command, arguments: list[str] | None = None) -> int:
    """Run one command and return its exit code; a failure becomes one sentence on stderr."""
    _open_streams()
    if VARIABLE in os.environ:  # a shell asks what can follow
        register()
    given = sys.argv[1:] if arguments is None else arguments
    if option := nameless(given):
        return _say(f"{option}: expected a name, got an empty one", 2)
    try:
        with results_alone("--json" in given), kept_alive():
            result = command.main(arguments, prog_name=_name(command), standalone_mode=False)
        return result if isinstance(result, int) else 0
    except click.exceptions.Exit as stop:
        return stop.exit_code
    except click.Abort as stop:
        if isinstance(stop.__cause__, EOFError):  # click takes it for the end of what is typed
            return _say(_too_short(str(stop.__cause__)), 1)
        return _say(_interrupted(stop.__cause__, command, arguments), EXIT_CODE)
    except click.exceptions.NoArgsIsHelpError as error:
        echo(error.format_message(), err=True)
        return 2
    except click.NoSuchOption as error:
        return _say(unknown_option(error, given), 2)
    except click.MissingParameter as error:
        return _say(missing(error), 2)
    except click.ClickException as error:
        return _say(unusable(error), 2)
    except LdtError as error:
        return _say(str(error), error.exit_code)
    except BrokenPipeError:  # the reader of our output, head for one, has left
        sys.stderr.close()
        return 1
    except MemoryError as error:
        return _say(f"out of memory ({error or 'no more is to be had'})", 1)
    except RuntimeError as error:
        if str(error) != NO_THREAD:
            return _unexpected(error)
        return _say(f"{error}: memory or the number of processes is at its limit", 1)
    except ImportError as error:  # of what is installed, or there is no memory to load it
        return _say(f"a library cannot be loaded: {error}{_shadowed(error)}", 1)
    except OSError as error:
        place = str(error.filename or _nameless())[:LONGEST_PLACE]
        code = 2 if error.errno in UNNAMEABLE else 1
        return _say(f"{place}: {error.strerror or error}", code)
    except Exception as error:
        return _unexpected(error)
    except BaseException as error:
        # Click ends so a shell's question for names, and where a reader has left.
        if isinstance(error, KeyboardInterrupt) or _raised_in(error) == CLICK:
            raise
        did = "would end the program" if isinstance(error, SystemExit) else NO_EXCEPTION
        return _say(f"a part of your own {did}: {reason_of(error)}", 1)


def _unexpected(error: Exception) -> int:
    """A sentence where a part of the user's own raised it; else it is a mistake of ours."""
    if place := own_place(error):
        return _say(f"{place}: {reason_of(error)}", 2)
    raise error


def _raised_in(error: BaseException) -> str:
    """Name of the module that raised it."""
    at = error.__traceback__
    while at is not None and at.tb_next is not None:
        at = at.tb_next
    return str(at.tb_frame.f_globals.get("__name__")) if at else ""


def _shadowed(error: ImportError) -> str:
    """Where a module is from that lacks a part: a file of the user's may have a library's name."""
    file = getattr(sys.modules.get(str(error.name).partition(".")[0]), "__file__", None)
    return f" ({file})" if file and "." in str(error.name) else ""


def _nameless() -> str:
    """What failed where the system names no file: the current folder, if it was deleted."""
    try:
        os.getcwd()
    except OSError:
        return "the current folder"
    return "input or output"


def _open_streams() -> None:
    """Stand in for standard streams that the caller has closed, as `2>&-` does.

    What is opened first would take their place, and get what is meant for them.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free
        if getattr(sys, name) is None:
            stream = open(os.devnull, "r+" if number == 0 else "w", encoding="utf-8")  # noqa: SIM115
            setattr(sys, name, stream)
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")  # a name that its encoding does not have


def _too_short(reason: str) -> str:
    """Of a file that ends too early; Python itself leaves such ones where a disk was full."""
    cure = "; a full disk may have cut it: delete the __pycache__ folders of the installation"
    reason = reason or "no more to be read"
    return f"a file ends too early: {reason}{cure if 'marshal' in reason else ''}"


def _interrupted(
    cause: BaseException | None, command: click.Command, arguments: list[str] | None
) -> str:
    """What is kept of interrupted work, and the command that goes on with it."""
    if not isinstance(cause, Interrupted):
        return "interrupted"
    same = f"{_name(command)} {shlex.join(sys.argv[1:] if arguments is None else arguments)}"
    return f"interrupted after {cause.kept}; go on with: {cause.command or same}"


def _name(command: click.Command) -> str:
    return "ldt" if command is ldt else f"ldt {command.name}"


def _say(sentence: str, code: int) -> int:
    with contextlib.suppress(OSError):  # nobody can be told where standard error is full
        echo(f"ldt: {' '.join(sentence.split())}", err=True)
    return code
