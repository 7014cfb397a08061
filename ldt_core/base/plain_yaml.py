"""YAML of others, read in memory that is in proportion to its text."""

from __future__ import annotations

from typing import Any

import yaml

#: The fast one where there is one; both are safe: no tags are obeyed.
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def load_yaml(text: str) -> Any:
    """The data in a YAML text without aliases.

    Aliases let two thousand characters stand for gigabytes as soon as anybody looks at all of it.

    Raises:
        yaml.YAMLError, ValueError, RecursionError: it is none, or has an alias.
    """
    if "*" in text:
        for event in yaml.parse(text, LOADER):
            if isinstance(event, yaml.AliasEvent):
                told = f"the alias *{event.anchor[:20]}, which is not read"
                raise yaml.MarkedYAMLError(problem=told, problem_mark=event.start_mark)
    return yaml.load(text, LOADER)  # noqa: S506 - see LOADER
