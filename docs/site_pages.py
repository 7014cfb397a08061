"""The pages of the documentation site: those of `ldt docs`, and a reference made from the code.

Nothing is written twice: pages, README and changelog are taken as they are, with their links turned
to the site's; commands come from click, the Python API from its docstrings, topics, messages and
parameters from `msgs_config`.
"""

from __future__ import annotations

import inspect
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import notebooks

import ldt_core
import msgs_config
from ldt_core import docs
from ldt_core.base.settings import flag_of
from ldt_core.cli import SECTIONS, ldt
from ldt_core.effects import EFFECTS, get_effect

REPOSITORY = Path(__file__).resolve().parents[1]
OWN = ("glossary", "gallery")  # pages of this folder
#: Heading → pages; each page of `ldt docs` has to stand here once.
NAV: dict[str, list[str]] = {
    "Start": ["start", "watch", "python"],
    "Tutorials": [*notebooks.names(), "connect", "real"],
    "How-to": [
        *("machine", "deploy", "network", "detector", "advice"),
        *("effect", "physics", "simulator"),
    ],
    "Explanation": ["diagnosis", "defaults", "paper"],
    "Reference": ["commands", "api", "topics", "parameters", "effects", "glossary"],
    "Evidence": ["accuracy", "limits", "streams", "promises", "speed"],
    "More": ["gallery", "changelog", "contributing"],
}
LINK = re.compile(r"\]\((?!https?://|#)([^)\s]+)\)")
COMMENT = re.compile(r"<!--.*?-->\n?", re.S)


def assemble(folder: Path) -> None:
    """Write all pages and pictures into a folder, which is made."""
    folder.mkdir(parents=True)
    shutil.copytree(REPOSITORY / "bags" / "figures", folder / "figures")
    for name in ("site.css", "site.js", "worker.js"):
        shutil.copy(REPOSITORY / "docs" / name, folder)
    made = {name: docs.text(name) for name in docs.names()}
    made |= {name: (REPOSITORY / "docs" / f"{name}.md").read_text() for name in OWN}
    made["index"] = (REPOSITORY / "README.md").read_text()
    made["changelog"] = (REPOSITORY / "CHANGELOG.md").read_text()
    made["contributing"] = (REPOSITORY / "CONTRIBUTING.md").read_text()
    for name in notebooks.names():
        made[name] = notebooks.as_markdown(name, folder / "notebook_figures")
    made |= {
        "commands": commands(),
        "api": api(),
        "topics": topics(),
        "parameters": parameters(),
        "effects": effects(),
    }
    for name, text in made.items():
        (folder / f"{name}.md").write_text(linked(COMMENT.sub("", text)), encoding="utf-8")


def linked(text: str) -> str:
    """A page with its links turned to the site's own pages and pictures.

    >>> linked("[a](../../bags/figures/a.png), [b](ldt_core/docs/b.md), [c](CHANGELOG.md)")
    '[a](figures/a.png), [b](b.md), [c](changelog.md)'
    """

    def turned(match: re.Match[str]) -> str:
        path, _, anchor = match[1].partition("#")
        behind = f"#{anchor}" if anchor else ""
        name = path.rpartition("/")[2]
        if name.endswith(".png"):
            own = "notebook_figures" if "notebook_figures" in path else "figures"
            return f"]({own}/{name}{behind})"
        if name in ("CHANGELOG.md", "CONTRIBUTING.md"):
            name = name.lower()
        return f"]({name}{behind})"

    return LINK.sub(turned, text)


def commands() -> str:
    """Every command with all of its options."""
    parts = ["# Commands", "`ldt --help` lists them; this page is made from what they declare."]
    context = click.Context(ldt, info_name="ldt")
    for heading, names in SECTIONS.items():
        parts.append(f"## {heading}")
        for name in names:
            command = ldt.get_command(context, name)
            if command is not None:
                parts += _command(command, f"ldt {name}")
    return "\n\n".join(parts) + "\n"


def _command(command: click.Command, path: str) -> Iterator[str]:
    yield f"### {path}"
    context = click.Context(command, info_name=path)
    paragraphs = inspect.cleandoc(command.help or "").split("\n\n")
    for text in paragraphs:
        example = text.removeprefix("Example: ")
        yield f"```bash\n{example}\n```" if text.startswith("Example: ") else _plain(text)
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            if inner is not None:
                yield from _command(inner, f"{path} {name}")
        return
    rows = []
    for parameter in command.params:
        record = parameter.get_help_record(context)
        if record:
            rows.append(f"| `{record[0].replace('|', '/')}` | {_plain(record[1])} |")
    if rows:
        yield "\n".join(["| option | does |", "|---|---|", *rows])


def api() -> str:
    """What `import ldt_core as ldt` offers, with its docstrings."""
    parts = ["# Python API", "All of it is there as `ldt.NAME` after `import ldt_core as ldt`."]
    for name in sorted(ldt_core.__all__, key=lambda n: (n[0].isupper(), n)):
        parts += _described(f"ldt.{name}", getattr(ldt_core, name))
    return "\n\n".join(parts) + "\n"


def _described(name: str, found: Any) -> Iterator[str]:
    yield f"## {name}"
    try:
        signature = str(inspect.signature(found))
    except (TypeError, ValueError):
        signature = ""
    if signature and len(signature) < 2000:
        yield f"```python\n{name}{signature}\n```"
    yield f"```text\n{inspect.getdoc(found) or ''}\n```"
    if inspect.isclass(found):
        for member, value in inspect.getmembers(found):
            own = member in vars(found) and not member.startswith("_")
            if own and (inspect.isfunction(value) or isinstance(value, property)):
                text = inspect.getdoc(value) or ""
                yield f"**`{member}`**: {_plain(text.partition(chr(10) + chr(10))[0])}"


def topics() -> str:
    """Topics, their quality of service, and the messages."""
    parts = [
        "# Topics and messages",
        "All names are relative: a namespace per machine gives a fleet. Standard messages only.",
        "| topic | message | QoS | recorded | published by | heard by |\n"
        "|---|---|---|---|---|---|\n"
        + "\n".join(
            f"| `{name}` | `{d['type']}` | {d['qos']} | {'yes' if d['recorded'] else 'no'} | "
            f"{', '.join(d.get('publisher', ())) or '–'} | "
            f"{', '.join(d.get('subscriber', ())) or '–'} |"
            for name, d in msgs_config.topics().items()
        ),
        "## Quality of service",
        "| profile | reliability | durability | history | depth |\n|---|---|---|---|---|\n"
        + "\n".join(
            f"| {name} | {q['reliability']} | {q['durability']} | {q['history']} | {q['depth']} |"
            for name, q in msgs_config.qos_profiles().items()
        ),
        "## Messages",
    ]
    for kind, text in msgs_config.messages().items():
        parts.append(f"### {kind}\n\n```text\n{text.strip()}\n```")
    return "\n\n".join(parts) + "\n"


def parameters() -> str:
    """Every parameter of nodes and commands."""
    rows = [
        "| option | type | default | range or choices | is |",
        "|---|---|---|---|---|",
    ]
    for name, d in msgs_config.parameters().items():
        limits = d.get("range") or [c for c in d.get("choices", ()) if c]
        shown = " to ".join(f"{v:g}" for v in limits) if "range" in d else ", ".join(limits)
        unit = f" [{d['unit']}]" if d.get("unit") else ""
        default = d["default"] if d["default"] not in ("", []) else "–"
        rows.append(
            f"| `{flag_of(name)}` | {d['type']} | {default} | {shown or '–'} | "
            f"{_plain(d['description'])}{unit} |"
        )
    head = (
        "Options of commands and ROS parameters of nodes are the same, declared once. A parameter "
        "has underscores: `--checkpoint-every` is `checkpoint_every`."
    )
    return f"# Parameters\n\n{head}\n\n" + "\n".join(rows) + "\n"


def effects() -> str:
    """Every effect that ships with LDT."""
    parts = ["# Effects", "`ldt effects` lists them, `ldt simulate --effect NAME` lets one act."]
    for name in sorted(EFFECTS.builtin):
        effect = get_effect(name)
        rows = "\n".join(
            f"| `{p.name}` | {p.unit or '–'} | {_plain(p.description)} |" for p in effect.parameters
        )
        parts.append(
            f"## {name}\n\n{_plain(effect.description)}\n\n```text\n{effect.equation}\n```\n\n"
            f"| parameter | unit | is |\n|---|---|---|\n{rows}"
        )
    return "\n\n".join(parts) + "\n"


def _plain(text: str) -> str:
    """One line that Markdown and its tables take as it is."""
    words = " ".join(text.split())
    parts = re.split(r"(`[^`]*`)", words)  # a backslash in code would be shown
    for index in range(0, len(parts), 2):
        for letter in "|<>*_[]":
            plain = f"\\{letter}" if letter not in "<>" else f"&#{ord(letter)};"
            parts[index] = parts[index].replace(letter, plain)
    return "".join(parts)
