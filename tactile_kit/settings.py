"""The base of all settings, and what it says of those that are wrong."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from tactile_kit.errors import nearest

WIDEST = 65_536  # units of a layer
Layers = Annotated[
    tuple[Annotated[int, Field(ge=1, le=WIDEST)], ...], Field(min_length=1, max_length=32)
]  # widths of hidden layers

_UNKNOWN = "unknown_setting"


class Settings(BaseModel):
    """Frozen; unknown keys fail with the nearest valid name, numbers that are not finite too."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, values: Any) -> Any:
        if isinstance(values, Mapping):
            known = [field.alias or name for name, field in cls.model_fields.items()]
            unknown = [f"{key}: unknown{nearest(key, known)}" for key in values if key not in known]
            if unknown:
                raise PydanticCustomError(_UNKNOWN, "{keys}", {"keys": "; ".join(unknown)})
        return values

    def changed(self, changes: Mapping[str, Any]) -> Self:
        """These settings with others in place, nested ones too, validated as a whole. Raises ValidationError."""
        return type(self)(**merge(self.model_dump(), changes))


def merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Nested mappings, ``over`` winning."""
    merged = dict(base)
    for key, value in over.items():
        both = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        merged[key] = merge(merged[key], value) if both else value
    return merged


def explain(problem: ValidationError) -> str:
    """What pydantic found wrong, in one line: each setting's dotted name, what is allowed, and what was given."""
    lines = []
    for error in problem.errors():
        place, said = ".".join(map(str, error["loc"])), error["msg"].removeprefix("Value error, ")
        text = (".".join if error["type"] == _UNKNOWN else ": ".join)(filter(None, [place, said]))
        lines.append(
            text if isinstance(error["input"], Mapping) else f"{text} (given: {short(error['input'])})"
        )
    return "; ".join(lines)


def short(value: Any) -> str:
    """``repr``, but aliases can make a few lines of YAML a value of any length."""
    return reprlib.repr(value)[:200]
