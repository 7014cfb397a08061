"""The documentation site: `python docs/build_site.py [FOLDER]`, by default build/site.

It loads nothing from elsewhere and works from the disk. A broken link ends the build.
"""

from __future__ import annotations

import argparse
import logging
import re
import sys
import tempfile
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from site_pages import NAV, REPOSITORY, assemble

EMPTY_HEAD = re.compile(r"<th([^>]*)></th>")
LOADED = {"script": "src", "link": "href", "img": "src", "iframe": "src"}
#: A link element's relations that make a browser load something.
LOADING = ("stylesheet", "icon", "preload", "preconnect", "modulepreload")


def build(site: Path) -> list[str]:
    """Build it; what is wrong with it, a sentence each.

    Args:
        site: folder to make.
    """
    from mkdocs.commands.build import build as mkdocs_build
    from mkdocs.config import load_config

    with tempfile.TemporaryDirectory() as folder:
        pages = Path(folder) / "docs"
        assemble(pages)
        settings = Path(folder) / "mkdocs.yml"
        settings.write_text("site_name: LDT\n")
        logging.getLogger("mkdocs").setLevel(logging.WARNING)
        config = load_config(
            config_file=str(settings),
            docs_dir=str(pages),
            site_dir=str(site),
            site_name="LDT, the learning digital twin",
            use_directory_urls=False,
            strict=True,
            theme={
                "name": "material",
                "font": False,
                "features": ["navigation.tabs", "navigation.top"],
                "palette": [
                    {
                        "media": "(prefers-color-scheme: light)",
                        "scheme": "default",
                        "toggle": {"icon": "material/weather-night", "name": "Switch to dark"},
                    },
                    {
                        "media": "(prefers-color-scheme: dark)",
                        "scheme": "slate",
                        "toggle": {"icon": "material/weather-sunny", "name": "Switch to light"},
                    },
                ],
            },
            extra_css=["site.css"],
            extra_javascript=["site.js"],
            plugins=["search"],
            markdown_extensions=["tables", "fenced_code", "toc", "pymdownx.superfences"],
            validation={"links": {"not_found": "warn", "anchors": "warn"}},
            nav=[{"Home": "index.md"}, *({h: [f"{n}.md" for n in ns]} for h, ns in NAV.items())],
            extra={"generator": False, "polyfills": ["worker.js"]},
        )
        mkdocs_build(config)
    found = (site / "search" / "search_index.json").read_text("utf-8")
    (site / "search" / "search_index.js").write_text(f"var __index = {found}", "utf-8")
    for page in site.rglob("*.html"):  # a corner of a table that heads nothing is no heading
        page.write_text(EMPTY_HEAD.sub(r"<td\1></td>", page.read_text("utf-8")), "utf-8")
    return [fault for page in sorted(site.rglob("*.html")) for fault in faults(page, site)]


class _Links(HTMLParser):
    """What a page links to, loads, and can be linked at."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.anchors: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = {name: value or "" for name, value in attrs}
        self.anchors |= {found[name] for name in ("id", "name") if name in found}
        if tag == "a" and "href" in found:
            self.links.append(found["href"])
        loads = tag != "link" or any(r in LOADING for r in found.get("rel", "").split())
        if loads and found.get(LOADED.get(tag, "")):
            self.loaded.append(found[LOADED[tag]])


def read_links(page: Path) -> _Links:
    """Of a page."""
    parser = _Links()
    parser.feed(page.read_text(encoding="utf-8"))
    return parser


def faults(page: Path, site: Path) -> list[str]:
    """Links that lead nowhere, and what is loaded from elsewhere."""
    found, told = read_links(page), []
    where = page.relative_to(site)
    for address in found.loaded:
        if urlsplit(address).scheme not in ("", "data") or address.startswith("//"):
            told.append(f"{where} loads {address}")
    for address in (*found.links, *found.loaded):
        parts = urlsplit(address)
        if parts.scheme or parts.netloc or not parts.path:
            continue
        if page.name == "404.html":
            continue  # its addresses are those of the server's root
        if not (page.parent / unquote(parts.path)).exists():
            told.append(f"{where} links to {address}, which is not there")
    return told


def main() -> int:
    """Build; exit code 1 where something is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=REPOSITORY / "build" / "site")
    site = parser.parse_args().folder.resolve()
    found = build(site)
    print("\n".join(found) or f"{site}/index.html")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
