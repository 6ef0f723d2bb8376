"""Randomisations as YAML: the presets of this package and anybody's own files."""

from __future__ import annotations

import reprlib
from dataclasses import fields
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from randomization.distributions import KINDS, Distribution
from randomization.errors import RandomizationError, nearest
from randomization.sampling import Randomization, Term

DATA = Path(__file__).parent / "data"
# beside its own errors, what PyYAML raises for values that are not what their tag says (``!!int ""``, ``!!bool x``)
RAISES = (ValueError, LookupError, AttributeError, TypeError, OverflowError, RecursionError)
PRESETS = ("none", "default", "strong")
Model = TypeVar("Model", bound=BaseModel)


class _Quantity(BaseModel):
    """One entry of terms.yaml."""

    model_config = ConfigDict(extra="forbid")
    meaning: str
    unit: str
    size: int = Field(default=1, ge=1)
    range: tuple[float, float]
    when: str = Field(pattern=r"^(run|episode|step|interval:\d+(\.\d+)?)$")


class _File(BaseModel):
    """A preset or an own file: terms given here replace those of the preset it extends."""

    model_config = ConfigDict(extra="forbid")
    summary: str = ""
    extends: Literal["none", "default", "strong"] | None = None
    terms: dict[str, dict[str, Any]] = {}


def preset(name: str) -> Randomization:
    """The preset "none", "default" or "strong", or an own file if ``name`` ends in .yaml or .yml.

    Raises ``RandomizationError`` with the nearest valid name for anything else.
    """
    if name.endswith((".yaml", ".yml")):
        return read_randomization(name)
    if name not in PRESETS:
        raise RandomizationError(f"unknown randomisation preset {name!r}" + nearest(name, PRESETS))
    return _shipped(name)


@lru_cache
def _shipped(name: str) -> Randomization:
    return read_randomization(DATA / "presets" / f"{name}.yaml")


def read_randomization(path: str | Path) -> Randomization:
    """Read an own file; ``RandomizationError`` names file, key, value and what is allowed."""
    path = Path(path)
    content = _validated(_File, _parse(path), path)
    quantities = _quantities()
    terms = dict(preset(content.extends).terms) if content.extends else {}
    for name, entry in content.terms.items():
        if name not in quantities:
            raise RandomizationError(f"{path}: terms.{name}: unknown term" + nearest(name, quantities))
        terms[name] = _term(name, quantities[name], dict(entry), f"{path}: terms.{name}")
    missing = [name for name in quantities if name not in terms]
    if missing:
        names = ", ".join(missing)
        raise RandomizationError(f"{path}: no distribution for {names}; give all terms or 'extends: none'")
    return Randomization(path.stem, (terms[name] for name in quantities), content.summary)


def write_randomization(randomization: Randomization, path: str | Path) -> None:
    """Write all terms to a file that ``read_randomization`` reads back as an equal randomisation."""
    items = randomization.terms.items()
    terms = {name: {**_plain(term.distribution), "source": term.source} for name, term in items}
    text = yaml.safe_dump({"summary": randomization.summary, "terms": terms}, sort_keys=False, width=110)
    Path(path).write_text(text, encoding="utf-8")


def _term(name: str, quantity: _Quantity, entry: dict[str, Any], place: str) -> Term:
    source = entry.pop("source", "")
    distribution = _distribution(entry, place)
    size, unit, allowed = quantity.size, quantity.unit, quantity.range
    try:
        return Term(name, distribution, size, unit, allowed, quantity.when, quantity.meaning, source)
    except RandomizationError as error:
        raise RandomizationError(f"{place}: {error}") from None


def _distribution(entry: dict[str, Any], place: str) -> Distribution:
    values = dict(entry)
    kind = values.pop("distribution", None)
    if kind not in KINDS:
        raise RandomizationError(f"{place}.distribution = {kind!r}: unknown" + nearest(kind, KINDS))
    names = [field.name for field in fields(KINDS[kind])]
    for key, value in values.items():
        if key not in names:
            hint = nearest(key, [*names, "source"])
            raise RandomizationError(f"{place}.{key}: unknown key of {kind}{hint}")
        if isinstance(value, dict):
            values[key] = _distribution(value, f"{place}.{key}")
    absent = [name for name in names if name not in values]
    if absent:
        raise RandomizationError(f"{place}: {kind} needs {' and '.join(absent)}")
    try:
        return KINDS[kind](**values)
    except (TypeError, ValueError) as error:  # a RandomizationError, or what float() raises
        raise RandomizationError(f"{place}: {error}") from None


def _plain(distribution: Distribution) -> dict[str, Any]:
    kind = next(name for name, cls in KINDS.items() if type(distribution) is cls)
    entry: dict[str, Any] = {"distribution": kind}
    for field in fields(distribution):  # type: ignore[arg-type]
        value = getattr(distribution, field.name)
        if isinstance(value, tuple):
            entry[field.name] = list(value)
        else:
            entry[field.name] = _plain(value) if isinstance(value, Distribution) else value
    return entry


@lru_cache
def _quantities() -> dict[str, _Quantity]:
    path = DATA / "terms.yaml"
    return {name: _validated(_Quantity, entry, path) for name, entry in _parse(path).items()}


def _parse(path: Path) -> dict[str, Any]:
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RandomizationError(f"{path}: can't be read ({error.strerror})") from None
    except (yaml.YAMLError, *RAISES) as error:
        raise RandomizationError(f"{path}: no valid YAML: {error}") from None
    if not isinstance(content, dict):
        raise RandomizationError(f"{path}: holds a {type(content).__name__}: allowed is a mapping of keys")
    return content


def _validated(model: type[Model], content: dict[str, Any], path: Path) -> Model:
    try:
        return model.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(item) for item in first["loc"])
        if first["type"] == "extra_forbidden":
            hint = nearest(place, model.model_fields)
            raise RandomizationError(f"{path}: {place}: unknown key{hint}") from None
        given = reprlib.repr(first["input"])[
            :200
        ]  # aliases can make a few lines of YAML a value of any length
        raise RandomizationError(f"{path}: {place} = {given}: {first['msg']}") from None
