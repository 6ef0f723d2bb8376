"""Learners' state as named tensors and JSON values, the two things a checkpoint holds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

Tensors = dict[str, Tensor]
Values = dict[str, Any]


def pack(prefix: str, tensors: Mapping[str, Tensor]) -> Tensors:
    """Own contiguous copies of ``tensors`` under ``prefix/``."""
    return {f"{prefix}/{name}": tensor.detach().clone().contiguous() for name, tensor in tensors.items()}


def unpack(prefix: str, tensors: Mapping[str, Tensor]) -> Tensors:
    """The entries under ``prefix/``, without it."""
    start = prefix + "/"
    return {name[len(start) :]: tensor for name, tensor in tensors.items() if name.startswith(start)}


def pack_optimizer(prefix: str, optimizer: torch.optim.Optimizer) -> tuple[Tensors, Values]:
    """Moments and step counts as tensors, learning rates as values."""
    state = optimizer.state_dict()
    tensors = {
        f"{index}/{name}": torch.as_tensor(value)
        for index, entries in state["state"].items()
        for name, value in entries.items()
    }
    return pack(prefix, tensors), {"learning_rates": [group["lr"] for group in state["param_groups"]]}


def unpack_optimizer(
    prefix: str, optimizer: torch.optim.Optimizer, tensors: Mapping[str, Tensor], values: Mapping[str, Any]
) -> None:
    """Inverse of :func:`pack_optimizer`; raises ValueError when moments do not fit their parameters."""
    state = optimizer.state_dict()
    entries: dict[int, dict[str, Tensor]] = {}
    for name, tensor in unpack(prefix, tensors).items():
        number, key = name.split("/", 1)
        entries.setdefault(int(number), {})[key] = tensor.clone()
    parameters = [parameter for group in optimizer.param_groups for parameter in group["params"]]
    for index, entry in entries.items():
        shape = tuple(parameters[index].shape) if index < len(parameters) else None
        wanted = {"step": (), "exp_avg": shape, "exp_avg_sq": shape}
        if {name: tuple(moment.shape) for name, moment in entry.items()} != wanted:
            raise ValueError(f"optimiser state {prefix}/{index} does not fit the network")
    state["state"] = entries
    for group, rate in zip(state["param_groups"], values["learning_rates"], strict=True):
        group["lr"] = rate
    optimizer.load_state_dict(state)


def pack_numpy_generator(rng: np.random.Generator) -> Values:
    """State of a NumPy generator; its integers are plain JSON."""
    return dict(rng.bit_generator.state)


def unpack_numpy_generator(rng: np.random.Generator, state: Values) -> None:
    """Inverse of :func:`pack_numpy_generator`."""
    rng.bit_generator.state = state


class Means:
    """Running means of scalar tensors between two reports, without a synchronising ``item()`` a step."""

    def __init__(self) -> None:
        self._sums: dict[str, Tensor] = {}
        self._counts: dict[str, int] = {}

    def add(self, **scalars: Tensor) -> None:
        for name, scalar in scalars.items():
            value = scalar.detach()
            if name in self._sums:
                self._sums[name] += value
                self._counts[name] += 1
            else:
                self._sums[name] = value.clone()
                self._counts[name] = 1

    def take(self) -> dict[str, float]:
        """The means since the last call; raises FloatingPointError when one is not finite."""
        means = {name: float(total) / self._counts[name] for name, total in self._sums.items()}
        self._sums.clear()
        self._counts.clear()
        for name, value in means.items():
            if not np.isfinite(value):
                raise FloatingPointError(f"learning diverged: {name} is {value}")
        return means
