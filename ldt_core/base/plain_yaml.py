"""YAML without aliases: that of others, read in memory in proportion to its text, and ours."""

from __future__ import annotations

import re
from typing import Any

import yaml

#: The fast one where there is one; both are safe: no tags are obeyed.
LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
#: What `load_yaml` raises of a text that it does not read.
NO_YAML = (yaml.YAMLError, ValueError, RecursionError)
INTEGER, FLOAT = "tag:yaml.org,2002:int", "tag:yaml.org,2002:float"

#: Lists and mappings within each other; the files that we know have five. libyaml's composer calls
#: itself for each, and from some ten thousand on the process ends without a word.
DEEPEST = 100


class _Loader(LOADER):  # type: ignore[misc]
    """Takes a key once, and for numbers what people write for one.

    YAML 1.1 takes the second of two values without a word, 20:00 for 1200, 010 for 8, and 1e-3,
    which is a number in JSON too, for a text.
    """

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        seen: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue  # refused below: no key of a mapping
            if key.value in seen:
                told = f"the key {key.value[:20]} a second time"
                raise yaml.MarkedYAMLError(problem=told, problem_mark=key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep)


_Loader.yaml_implicit_resolvers = {
    first: [(tag, form) for tag, form in forms if tag not in (INTEGER, FLOAT)]
    for first, forms in LOADER.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver(INTEGER, re.compile(r"[-+]?(0|[1-9][0-9]*)$"), list("-+0123456789"))
_Loader.add_implicit_resolver(
    FLOAT,
    re.compile(
        r"[-+]?([0-9]+\.[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?$|[-+]?[0-9]+[eE][-+]?[0-9]+$|"
        r"[-+]?\.(inf|Inf|INF)$|\.(nan|NaN|NAN)$"
    ),
    list("-+0123456789."),
)


class PlainDumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
    """YAML without anchors: `load_yaml` takes no aliases, and few readers of bag metadata do."""

    def ignore_aliases(self, data: Any) -> bool:
        """Of nothing."""
        return True


def load_yaml(text: str) -> Any:
    """The data in a YAML text without aliases, nested `DEEPEST` deep at most, each key once.

    Aliases let two thousand characters stand for gigabytes as soon as anybody looks at all of it.

    Raises:
        One of NO_YAML: it is none, has an alias or a key twice, or is nested deeper.
    """
    if "*" in text or _may_be_deep(text):
        _refuse_alias_and_depth(text)
    return yaml.load(text, _Loader)  # noqa: S506 - see LOADER


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
