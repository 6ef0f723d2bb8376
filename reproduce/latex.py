"""LaTeX tables that fit the paper's two columns: text escaped, one line a row, packages named in the first line."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

PACKAGES = "% Needs the package booktabs."
_SPECIAL = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
}


def escape(text: str) -> str:
    """Plain text as LaTeX shows it. Names of runs hold underscores, which outside of formulas are errors."""
    return "".join(_SPECIAL.get(sign, sign) for sign in text)


def row(*cells: str) -> str:
    """A line of a tabular; ``cells`` are LaTeX already."""
    return "    " + " & ".join(cells) + r" \\"


def table(
    columns: str, lines: Iterable[str], caption: str, *, wide: bool = False, notes: Sequence[str] = ()
) -> str:
    """A float of a column, or of both where ``wide``; ``notes`` stand below, in the table's width.

    ``columns``: the tabular's specification. ``lines``: its rows and rules. All are LaTeX already.
    """
    name = "table*" if wide else "table"
    below = [
        rf"  \par\smallskip\parbox{{0.95\linewidth}}{{\scriptsize\raggedright {note}}}" for note in notes
    ]
    return "\n".join(
        [
            PACKAGES,
            rf"\begin{{{name}}}",
            r"  \centering",
            rf"  \caption{{{caption}}}",
            r"  \footnotesize",
            r"  \setlength{\tabcolsep}{3pt}",
            rf"  \begin{{tabular}}{{{columns}}}",
            r"    \toprule",
            *lines,
            r"    \bottomrule",
            r"  \end{tabular}",
            *below,
            rf"\end{{{name}}}",
            "",
        ]
    )
