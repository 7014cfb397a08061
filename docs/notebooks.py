"""Notebooks without a kernel: cells are run in this process, what they print and draw is kept.

python docs/notebooks.py   runs all of docs/notebooks again and writes their outputs
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent / "notebooks"
FIRST = "a_twin_that_learns"
DPI = 80  # of pictures, small enough to be part of a repository


def names() -> list[str]:
    """Of all notebooks, in the order in which a newcomer reads them."""
    found = sorted(file.stem for file in FOLDER.glob("*.ipynb"))
    return sorted(found, key=lambda name: name != FIRST)


def read(name: str) -> dict[str, Any]:
    """A notebook as its JSON."""
    found: dict[str, Any] = json.loads((FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))
    return found


def code_cells(notebook: dict[str, Any]) -> list[dict[str, Any]]:
    """Those that are run."""
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def executed(notebook: dict[str, Any]) -> dict[str, Any]:
    """The notebook with new outputs, run from its first cell on in an empty folder."""
    space: dict[str, Any] = {"__name__": "__main__"}
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for number, cell in enumerate(code_cells(notebook), start=1):
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed):
                value = _run("".join(cell["source"]), f"cell {number}", space)
            cell["execution_count"] = number
            cell["outputs"] = [*_stream(printed.getvalue()), *_shown(value)]
    return notebook


def _run(source: str, name: str, space: dict[str, Any]) -> Any:
    """Run a cell; the value of its last line, where that is an expression."""
    tree = ast.parse(source)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, name, "exec"), space)  # noqa: S102 - notebooks of our own
    if not isinstance(last, ast.Expr):
        return None
    return eval(compile(ast.Expression(last.value), name, "eval"), space)  # noqa: S307


def _stream(text: str) -> Iterator[dict[str, Any]]:
    if text:
        lines = text.splitlines(keepends=True)
        yield {"output_type": "stream", "name": "stdout", "text": lines}


def _shown(value: Any) -> Iterator[dict[str, Any]]:
    """What Jupyter shows of a cell's last value: a figure, or its text."""
    if hasattr(value, "savefig"):
        stream = io.BytesIO()
        value.savefig(stream, format="png", dpi=DPI)
        data = base64.b64encode(stream.getvalue()).decode()
        yield {"output_type": "display_data", "data": {"image/png": data}, "metadata": {}}
    elif value is not None:
        yield from _stream(f"{value!r}\n")


def printed(notebook: dict[str, Any]) -> list[str]:
    """What each code cell printed."""
    return [
        "".join(text for out in cell["outputs"] for text in out.get("text", ()))
        for cell in code_cells(notebook)
    ]


def as_markdown(name: str, figures: Path) -> str:
    """A notebook as a page of the site; its pictures go into a folder.

    Args:
        figures: made if need be; the page lies beside it.
    """
    parts, count = [], 0
    for cell in read(name)["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        for out in cell["outputs"]:
            if "text" in out:
                parts.append(f"```text\n{''.join(out['text'])}```")
            else:
                count += 1
                figures.mkdir(parents=True, exist_ok=True)
                file = figures / f"{name}_{count}.png"
                file.write_bytes(base64.b64decode(out["data"]["image/png"]))
                parts.append(f"![What the cell above draws]({figures.name}/{file.name})")
    parts.append(f"The notebook itself: `docs/notebooks/{name}.ipynb`.")
    return "\n\n".join(parts) + "\n"


def main() -> None:
    """Run all again."""
    for name in sys.argv[1:] or names():
        text = json.dumps(executed(read(name)), indent=1, ensure_ascii=False) + "\n"
        (FOLDER / f"{name}.ipynb").write_text(text, encoding="utf-8")
        print(name)


if __name__ == "__main__":
    main()
