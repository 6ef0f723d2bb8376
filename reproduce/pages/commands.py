"""Every command with its arguments, read off the functions and classes that are the command line."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
import textwrap
import typing
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_origin

import docstring_parser

from reproduce.pages.markdown import table

HEAD = """# Commands

<!-- Made from the code by `make docs`; edit the docstrings of the commands instead. -->

Two commands are installed. `--help` after any of them says the same in the terminal. Progress goes to stderr, results
to stdout; errors are one line and exit status 2, Ctrl-C and SIGTERM end cleanly (130, 143).
"""


class Argument(NamedTuple):
    """One argument: how it is written, what it is by default (empty: it has to be given), what it means."""

    name: str
    default: str
    meaning: str


def page() -> str:
    """The markdown of all commands."""
    from object_sets import cli as sets
    from reproduce import cli

    parts = [HEAD, "## reproduce\n"]
    for command in cli.COMMANDS:
        parts.append(
            _section(
                "reproduce", command.__name__.replace("_", "-"), command.__doc__ or "", _of_function(command)
            )
        )
    parts.append("## object-sets\n")
    for choice in get_args(sets.Command):
        kind, *marks = get_args(choice)
        name = next(mark.name for mark in marks if hasattr(mark, "name"))
        parts.append(_section("object-sets", name, kind.__doc__ or "", _of_class(kind)))
    return "\n".join(parts).rstrip() + "\n"


def _section(program: str, name: str, docstring: str, arguments: list[Argument]) -> str:
    parsed = docstring_parser.parse(docstring)
    text = "\n\n".join(filter(None, [parsed.short_description, parsed.long_description]))
    rows = [(f"`{one.name}`", f"`{one.default}`" if one.default else "", one.meaning) for one in arguments]
    body = table(("argument", "default", "meaning"), rows) if rows else "No arguments.\n"
    return f"### {program} {name}\n\n{text}\n\n{body}"


def _of_function(command: Callable[..., Any]) -> list[Argument]:
    meanings = {
        one.arg_name: one.description or "" for one in docstring_parser.parse(command.__doc__ or "").params
    }
    hints = typing.get_type_hints(command, include_extras=True)
    return [
        _argument(name, hints[name], parameter.default, meanings[name])
        for name, parameter in inspect.signature(command).parameters.items()
    ]


def _of_class(kind: type[Any]) -> list[Argument]:
    hints, meanings = typing.get_type_hints(kind, include_extras=True), dict(_attribute_docs(kind))
    found = []
    for field in dataclasses.fields(kind):
        absent = field.default is dataclasses.MISSING
        default = inspect.Parameter.empty if absent else field.default
        if field.default_factory is not dataclasses.MISSING:
            default = None  # depends on the machine; the meaning says how
        found.append(_argument(field.name, hints[field.name], default, meanings.get(field.name, "")))
    return found


def _attribute_docs(kind: type[Any]) -> Iterator[tuple[str, str]]:
    """The strings below a class's attributes, which tyro shows too."""
    body = ast.parse(textwrap.dedent(inspect.getsource(kind))).body[0].body  # type: ignore[attr-defined]
    for statement, after in pairwise(body):
        said = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
        if isinstance(statement, ast.AnnAssign) and said and isinstance(statement.target, ast.Name):
            yield statement.target.id, inspect.cleandoc(after.value.value)  # type: ignore[attr-defined]


def _argument(name: str, hint: Any, default: Any, meaning: str) -> Argument:
    kind, marks = (hint, ()) if get_origin(hint) is not Annotated else (get_args(hint)[0], hint.__metadata__)
    settings = [mark for mark in marks if hasattr(mark, "metavar")]
    metavar = next((mark.metavar for mark in settings if mark.metavar), None)
    option = next((mark.name for mark in settings if mark.name), None) or name.replace("_", "-")
    positional = any("ositional" in repr(mark) for mark in marks)
    written = option.upper() if positional else f"--{option}"
    if kind is not bool and not positional:
        written += f" {(metavar or _values(kind)).replace('|', '/')}"
    shown = "" if default is inspect.Parameter.empty or default is None or default == "" else str(default)
    shown = "" if kind is bool else shown
    return Argument(written, shown, " ".join(meaning.split()).replace("<", "&lt;"))


def _values(kind: Any) -> str:
    """What may stand after an option."""
    kinds = [one for one in get_args(kind) if one is not type(None)] or [kind]
    if get_origin(kind) is Literal:
        return "/".join(map(str, get_args(kind)))
    if get_origin(kinds[0]) is Literal:
        return "/".join(map(str, get_args(kinds[0])))
    names = {int: "N", float: "X", str: "TEXT", Path: "PATH"}
    return names.get(kinds[0]) or re.sub(r"\W+", " ", str(kinds[0])).strip().upper()
