"""YAML of others, read in memory that is in proportion to its text."""

from __future__ import annotations

from typing import Any

import yaml

#: The fast one where there is one; both are safe: no tags are obeyed.
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


#: Lists and mappings within each other; the files that we know have five. libyaml's composer calls
#: itself for each, and from some ten thousand on the process ends without a word.
DEEPEST = 100


def load_yaml(text: str) -> Any:
    """The data in a YAML text without aliases, nested `DEEPEST` deep at most.

    Aliases let two thousand characters stand for gigabytes as soon as anybody looks at all of it.

    Raises:
        yaml.YAMLError, ValueError, RecursionError: it is none, has an alias or is nested deeper.
    """
    if "*" in text or _may_be_deep(text):
        _refuse_alias_and_depth(text)
    return yaml.load(text, LOADER)  # noqa: S506 - see LOADER


def _may_be_deep(text: str) -> bool:
    """Whether it has the brackets, or a line the width, that deep nesting takes."""
    widest = max((len(line) for line in text.splitlines()), default=0)
    return text.count("[") + text.count("{") > DEEPEST or widest > DEEPEST


def _refuse_alias_and_depth(text: str) -> None:
    depth = 0
    for event in yaml.parse(text, LOADER):
        told = ""
        if isinstance(event, yaml.AliasEvent):
            told = f"the alias *{event.anchor[:20]}, which is not read"
        elif isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            told = f"nesting deeper than {DEEPEST}" if depth > DEEPEST else ""
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if told:
            raise yaml.MarkedYAMLError(problem=told, problem_mark=event.start_mark)
