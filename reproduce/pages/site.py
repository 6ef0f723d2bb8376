"""Hooks of the site's build (mkdocs.yml): notebooks become pages, links that leave docs/ go to the checkout's files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

OUTSIDE = re.compile(r"(?<!!)\[([^\]]+)\]\(((?:\.\./)+[^)\s]*)\)")
ROLE = re.compile(r":(?:class|func|meth|mod|attr):(?=<code|`)")  # of docstrings, which Sphinx would read
FENCE = re.compile(r"^(```|~~~)", re.MULTILINE)
TABLE = re.compile(r"<table>.*?</table>", re.DOTALL)
HEAD = re.compile(r"<th[^>]*>(.*?)</th>", re.DOTALL)
ROW = re.compile(r"<tr>.*?</tr>", re.DOTALL)
CELL = re.compile(r"<td([^>]*)>(.*?)</td>", re.DOTALL)
TAG = re.compile(r"<[^>]+>")


def on_files(files: Any, config: Any) -> Any:
    """Adds a page, and its pictures, for every notebook; they are shown as they were executed."""
    from mkdocs.structure.files import File
    from nbconvert import MarkdownExporter

    for notebook in sorted(Path(config["docs_dir"]).rglob("*.ipynb")):
        name = notebook.relative_to(config["docs_dir"]).with_suffix("")
        resources = {"output_files_dir": f"{name.name}_files"}
        text, made = MarkdownExporter().from_filename(str(notebook), resources=resources)
        where = f"*This page is the notebook `docs/{name}.ipynb`; the tests execute it.*"
        title, _, rest = text.lstrip().partition("\n")
        files.append(File.generated(config, f"{name}.md", content=f"{title}\n\n{where}\n{rest}"))
        for file, content in made["outputs"].items():
            files.append(File.generated(config, f"{name.parent}/{file}", content=content))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Links to files beside docs/ are left as they are: site/ lies beside docs/, so they hold there too."""
    depth = page.file.src_uri.count("/") + 1

    def link(found: re.Match[str]) -> str:
        text, target = found.groups()
        if target.count("../") < depth:
            return found.group(0)
        return f'<a href="{target}">{text}</a>'

    parts = FENCE.split(markdown)  # text, fence, code, fence, text, ...
    for at in range(0, len(parts), 4):
        parts[at] = OUTSIDE.sub(link, parts[at])
    return "".join(parts)


def on_page_content(html: str, page: Any, config: Any, files: Any) -> str:
    """Names in docstrings without the roles of another tool; cells of tables with the names of their columns."""
    return TABLE.sub(_labelled, ROLE.sub("", html))


def _labelled(found: re.Match[str]) -> str:
    """A table whose cells say their column, for phones, where every row is a card (docs/style/site.css)."""
    names = [TAG.sub("", name).strip() for name in HEAD.findall(found.group(0))]

    def cell(inside: re.Match[str], of_row: Iterator[str]) -> str:
        style, text, name = *inside.groups(), next(of_row)
        return f'<td{style} data-label="{name}"><div>{text}</div></td>' if text else inside.group(0)

    def row(cells: re.Match[str]) -> str:
        of_row = iter(names)
        return CELL.sub(lambda inside: cell(inside, of_row), cells.group(0))

    return ROW.sub(row, found.group(0))
