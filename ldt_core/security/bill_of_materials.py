"""What LDT consists of here: every library that it needs and that is installed, with its version.

Read from the metadata of what is installed; nothing is asked over a network. The bill is a
CycloneDX 1.5 document (ECMA-424), which scanners of vulnerabilities and licences take.
"""

from __future__ import annotations

import re
from importlib import metadata
from typing import Any

from packaging.requirements import Requirement

OWN = "ldt"
#: Code that stands in LDT's own files, not beside it: name → (version, licence, place).
EMBEDDED = {"uPlot": ("1.6.32", "MIT", "ldt_core/views/report/uplot")}


def components() -> dict[str, metadata.Distribution]:
    """Normalized name → what is installed of LDT, its needs and theirs, all extras included."""
    found: dict[str, metadata.Distribution] = {}
    waiting = [(OWN, frozenset[str]())]
    seen: set[tuple[str, frozenset[str]]] = set()
    while waiting:
        name, extras = waiting.pop()
        if (name, extras) in seen:
            continue
        seen.add((name, extras))
        try:
            part = metadata.distribution(name)
        except metadata.PackageNotFoundError:
            continue  # an extra that was not asked for
        found[normalized(name)] = part
        own = part.metadata.get_all("Provides-Extra") or []
        asked = set(own) if name == OWN else extras
        for text in part.requires or ():
            need = Requirement(text)
            if need.marker is None or any(need.marker.evaluate({"extra": e}) for e in (*asked, "")):
                waiting.append((need.name, frozenset(need.extras)))
    return dict(sorted(found.items()))


def normalized(name: str) -> str:
    """A package's name as indexes have it (PEP 503).

    >>> normalized("Jinja2"), normalized("ruamel_yaml.clib")
    ('jinja2', 'ruamel-yaml-clib')
    """
    return re.sub(r"[-_.]+", "-", name).lower()


def pinned() -> list[str]:
    """`name==version` of each, without LDT itself: constraints for pip."""
    return [f"{name}=={part.version}" for name, part in components().items() if name != OWN]


def bill() -> dict[str, Any]:
    """The CycloneDX document."""
    found = components()
    own = found.pop(OWN, None)
    listed = [_component(name, part.version, _licence(part)) for name, part in found.items()]
    listed += [
        {
            **_component(name, version, licence),
            "purl": f"pkg:npm/{name.lower()}@{version}",
            "properties": [{"name": "embedded in", "value": place}],
        }
        for name, (version, licence, place) in EMBEDDED.items()
    ]
    about = _component(OWN, own.version if own else "unknown", "Apache-2.0")
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {"component": {**about, "type": "application"}},
        "components": listed,
    }


def _component(name: str, version: str, licence: str) -> dict[str, Any]:
    made: dict[str, Any] = {
        "type": "library",
        "name": name,
        "version": version,
        "purl": f"pkg:pypi/{name}@{version}",
    }
    if licence:
        made["licenses"] = [{"license": {"name": licence}}]
    return made


def _licence(part: metadata.Distribution) -> str:
    """As its metadata says it, in one line; "" where it does not."""
    about = part.metadata
    names = ("License-Expression", "License")
    said = next((text for name in names for text in about.get_all(name) or () if text), "")
    classes = [c for c in about.get_all("Classifier") or [] if c.startswith("License :: ")]
    if (not said or len(said) > 100) and classes:
        said = classes[0].rpartition(" :: ")[2]
    return " ".join(said.split())[:100]


if __name__ == "__main__":  # python -m ldt_core.security.bill_of_materials > constraints.txt
    print("\n".join(pinned()))
