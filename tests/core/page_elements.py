"""What a page is made of, as a browser reads it."""

from __future__ import annotations

import re
from html.parser import HTMLParser

VOID = {"meta", "br", "link", "img", "base", "input", "hr"}
LOADING = {"link", "iframe", "object", "img", "base"}
#: A target on the page itself, or also a file beside it.
ON_PAGE, BESIDE = re.compile(r"#|$"), re.compile(r"(?!\w+:|//)")


class Elements(HTMLParser):
    """All start tags with their attributes, the scripts' texts, and the text outside of both."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.text, self.scripts, self.open = [], "", [], []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "script":
            self.scripts.append((dict(attrs), ""))

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == "script":
            attributes, text = self.scripts.pop()
            self.scripts.append((attributes, text + data))
        elif "style" not in self.open:
            self.text += data


def needs_nothing_else(page, targets=ON_PAGE):
    """Its elements: no address to load from, every element closed, each identifier once."""
    elements = Elements(page)
    assert not elements.open
    assert not {t for t, _ in elements.tags} & LOADING
    for tag, attributes in elements.tags:
        for name in ("src", "href", "xlink:href", "action"):
            assert targets.match(attributes.get(name) or ""), (tag, attributes)
    assert "@import" not in page
    found = [a["id"] for _, a in elements.tags if a.get("id")]
    assert len(found) == len(set(found))
    return elements


def colours_follow_the_scheme(page):
    """No fixed colour in an inlined drawing."""
    for svg in re.findall(r"<svg.*?</svg>", page, flags=re.DOTALL):
        assert not re.search(r"#[0-9a-fA-F]{6}\b", svg), re.search(r".{60}#[0-9a-fA-F]{6}", svg)
