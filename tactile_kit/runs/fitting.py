"""Whether what a checkpoint holds is what the run that takes it up would save itself: names, shapes, types, numbers.

Digests tell damage, not who wrote them. What fits in this way is then looked at by those whose state it is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

# What a run that has only just begun does not have yet; its owners hold it against their networks and environments.
LATER = (
    "learner/optimizer/",
    "learner/observation",
    "learner/episode_starts",
    "env/trainer.adam.",
    "env/memory.",
    "env/measured.",
)


def require_tensors(own: Mapping[str, Tensor], found: Mapping[str, Tensor]) -> None:
    """Raises ValueError naming a tensor that is missing, unknown, not finite, or of another shape or type."""
    if missing := sorted(own.keys() - found.keys()):
        raise ValueError(f"{missing[0]} is missing")
    for name, tensor in found.items():
        if name in own:
            wanted = own[name]
            if tensor.shape != wanted.shape or tensor.dtype != wanted.dtype:
                what, allowed = (
                    f"{tuple(t.shape)} {str(t.dtype).removeprefix('torch.')}" for t in (tensor, wanted)
                )
                raise ValueError(f"{name} is {what}, allowed is {allowed}")
        elif not name.startswith(LATER):
            raise ValueError(f"{name} is unknown")
        if not torch.isfinite(tensor).all():
            raise ValueError(f"{name} holds what is no finite number")


def require_values(own: Any, found: Any, name: str = "values") -> None:
    """Raises ValueError naming an entry that is missing or of another kind than in ``own``; no number is below 0.

    None in ``own`` stands for what may not be there yet; lists are of any finite numbers, and mappings may have grown.
    """
    if isinstance(own, Mapping):
        if not isinstance(found, Mapping):
            raise ValueError(f"{name} is {found!r}, allowed are keys and values")
        for key, value in own.items():
            if key not in found:
                raise ValueError(f"{name}.{key} is missing")
            require_values(value, found[key], f"{name}.{key}")
    elif isinstance(own, list):
        if not isinstance(found, list) or not all(map(_finite, found)):
            raise ValueError(f"{name} is no list of finite numbers")
    elif isinstance(own, (bool, str)):
        if type(found) is not type(own):
            raise ValueError(f"{name} is {found!r}, allowed is a {type(own).__name__}")
    elif own is not None:
        whole = isinstance(own, int)
        if not _finite(found) or found < 0 or (whole and not isinstance(found, int)):
            raise ValueError(
                f"{name} is {found!r}, allowed are {'whole' if whole else 'finite'} numbers from 0"
            )


def _finite(value: Any) -> bool:
    return type(value) in (int, float) and math.isfinite(value)
