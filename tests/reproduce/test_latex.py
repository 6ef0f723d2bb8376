"""Tables are sound LaTeX that fits a two-column paper: read by a small parser always, compiled where a compiler is."""

from __future__ import annotations

import re
import shutil
import subprocess

import pytest

import object_sets
from reproduce.artefacts import make
from reproduce.files import ROOT
from reproduce.inventory import ABLATED, TACTILE
from reproduce.latex import escape
from reproduce.plan import TABLES

THINGS = {thing.id: thing for thing in object_sets.load("all")}
TEXT_WIDTH = 516.0  # pt, of IEEE's two columns; the paper's class
KNOWN = {
    "begin", "end", "centering", "caption", "footnotesize", "scriptsize", "raggedright", "setlength", "tabcolsep",
    "toprule", "midrule", "bottomrule", "multicolumn", "textit", "par", "smallskip", "parbox", "linewidth", "sigma",
    "mathcal", "textbackslash", "textasciitilde", "textasciicircum", "textless", "textgreater",
}  # fmt: skip


def faults(tex: str) -> list[str]:
    """What LaTeX would complain of, in words; empty for a sound table."""
    found = [f"{sign!r} is not ASCII" for sign in sorted(set(re.findall(r"[^\x00-\x7f]", tex)))]
    tex = re.sub(r"(?<!\\)%.*", "", tex)
    found += [f"\\{name} unknown" for name in sorted(set(re.findall(r"\\([A-Za-z]+)", tex)) - KNOWN)]
    depth, names = 0, []
    for sign in re.findall(r"\\.|[{}]", tex):
        depth += {"{": 1, "}": -1}.get(sign, 0)
        if depth < 0:
            break
    if depth:
        found.append("braces do not match")
    for verb, name in re.findall(r"\\(begin|end)\{([^}]*)\}", tex):
        if verb == "begin":
            names.append(name)
        elif not names or names.pop() != name:
            found.append(f"{name} ends where it has not begun")
    found += [f"{name} does not end" for name in names]
    plain = re.sub(r"\\.", "", tex)
    if plain.count("$") % 2:
        found.append("a formula does not end")
    body = re.search(r"\\begin\{tabular\}\{([lcr ]+)\}(.*?)\\end\{tabular\}", tex, re.DOTALL)
    outside = re.sub(r"\$[^$]*\$", "", plain)
    outside = re.sub(r"\{tabular\}\{[lcr ]+\}", "", outside)
    found += [f"{sign} outside a formula" for sign in "_^#~" if sign in outside]
    if body is None:
        return [*found, "no tabular"]
    columns = len(body[1].replace(" ", ""))
    for cells in cells_of(body[2]):
        width = sum(int(m[1]) if (m := re.match(r"\\multicolumn\{(\d+)\}", cell)) else 1 for cell in cells)
        if width != columns:
            found.append(f"{width} cells of {columns}: {' & '.join(cells)}")
    if "&" in re.sub(r"\\.", "", tex.replace(body[0], "")):
        found.append("& outside the tabular")
    return found


def cells_of(body: str) -> list[list[str]]:
    lines = [re.sub(r"\\(top|mid|bottom)rule", "", line).strip() for line in body.split(r"\\")]
    return [[cell.strip() for cell in re.split(r"(?<!\\)&", line)] for line in lines if line]


def width(tex: str) -> float:
    """pt that the tabular takes in 8 pt Computer Modern, with 3 pt either side of a column."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    def of(cell: str) -> float:
        shown = re.sub(r"\\[,%]|\\[A-Za-z]+|[${}^]", "", cell)
        return TextPath((0, 0), shown, size=8, prop=FontProperties(family="cmr10")).get_extents().width

    lines = cells_of(re.search(r"\\begin\{tabular\}\{[^}]*\}(.*?)\\end\{tabular\}", tex, re.DOTALL)[1])
    full = [line for line in lines if not any("multicolumn" in cell for cell in line)]
    return sum(max(of(line[i]) if line[i] else 0 for line in full) + 6 for i in range(len(full[0])))


@pytest.fixture(scope="module")
def made(paper_world, tmp_path_factory):
    """The tables of a full world, and Table II where agents of unlike training leave reasons below it."""
    folder = tmp_path_factory.mktemp("tex")
    for name in TABLES:
        make(name, paper_world.results, [folder / f"{name}.csv", folder / f"{name}.tex"])
    return {name: (folder / f"{name}.tex").read_text() for name in TABLES}


def unlike(world, folder):
    for role, steps in ((TACTILE, 10**7), (ABLATED["no_shape"], 10**5), (ABLATED["no_sigma"], 10**5)):
        world.evaluated(role, "nominal", [r for i in range(13) for r in world.draw(role, THINGS[i], 6, 12)])
        world.run(role, steps=steps)
    make("table2", world.results, [folder / "table2.csv", folder / "table2.tex"])
    return (folder / "table2.tex").read_text()


def everything(made, world, folder) -> dict[str, str]:
    shipped = {f"results/{name}": (ROOT / "results" / "tables" / f"{name}.tex").read_text() for name in made}
    return {**made, **shipped, "unlike": unlike(world, folder)}


def test_tables_are_sound_and_fit(made, world, tmp_path):
    for name, tex in everything(made, world, tmp_path).items():
        assert faults(tex) == [], name
        assert tex.count(r"\begin{table*}") == 1 and width(tex) < TEXT_WIDTH, (name, width(tex))


def test_reasons_stand_below_the_table_once(world, tmp_path):
    tex = unlike(world, tmp_path)
    below = tex[tex.index(r"\end{tabular}") :]
    assert below.count("not trained alike") == 2 and r"tactile-vec\_bps-geometric8" in below
    assert tex.count("undefined$^{a}$") == tex.count("undefined$^{b}$") == 2


@pytest.mark.parametrize(
    "old, new, word",
    [
        ("Convex", "Con_vex", "_ outside"), ("Convex", "Convex &", "cells of"), ("Convex", "Con{vex", "braces"),
        ("Convex", "$Convex", "formula"), ("Convex", r"\makecell{Convex}", "makecell"), ("Convex", "Convéx", "ASCII"),
        (r"\end{tabular}", "", "tabular"), ("Convex", "Con#vex", "# outside"), ("Scale", "This & that", "& outside"),
    ],
)  # fmt: skip
def test_the_parser_sees_faults(made, old, new, word):
    assert any(word in fault for fault in faults(made["table1"].replace(old, new, 1)))


def test_escapes():
    assert escape("a_b 5% {x} #1 $ & ~^\\") == (
        r"a\_b 5\% \{x\} \#1 \$ \& \textasciitilde{}\textasciicircum{}\textbackslash{}"
    )


def test_tables_compile(made, world, tmp_path):
    compiler = next(filter(None, map(shutil.which, ("tectonic", "pdflatex"))), None)
    if compiler is None:
        pytest.skip("no LaTeX: neither tectonic nor pdflatex is installed")
    tables = "\n".join(everything(made, world, tmp_path).values())
    (tmp_path / "paper.tex").write_text(
        "\\documentclass[twocolumn]{article}\n\\usepackage{booktabs}\n\\usepackage[textwidth=516pt]{geometry}\n"
        f"\\begin{{document}}\n{tables}\n\\end{{document}}\n"
    )
    options = [] if compiler.endswith("tectonic") else ["-halt-on-error", "-interaction=nonstopmode"]
    done = subprocess.run(
        [compiler, *options, "paper.tex"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr
    assert "Overfull" not in done.stdout + done.stderr
