"""Perceptrons whose layers all read the input (D2RL), without ever concatenating it to what is hidden.

``W [h; x] = W_h h + W_x x``, so the input is multiplied once, by the input columns of all layers in one wide product;
each layer adds its product of the hidden units. That saves the copies, and in the backward pass the gradient of an
input that nobody asks for.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn
from torch.autograd.function import once_differentiable

from tactile_kit.agents.config import NetworkConfig

ACTIVATIONS: dict[str, type[nn.Module]] = {"elu": nn.ELU, "relu": nn.ReLU, "silu": nn.SiLU}


class Perceptron(nn.Module):
    """Hidden layers ``(B, F) -> (B, hidden[-1])``; with ``dense`` every layer reads the input too (D2RL).

    The input's columns are the last of every weight matrix that reads it.
    """

    def __init__(self, inputs: int, config: NetworkConfig) -> None:
        super().__init__()
        self.dense = config.dense
        self.activation = ACTIVATIONS[config.activation]()
        widths = [0, *config.hidden]
        self.layers = nn.ModuleList(
            nn.Linear(before + (inputs if index == 0 or config.dense else 0), after)
            for index, (before, after) in enumerate(pairwise(widths))
        )
        norms = [nn.LayerNorm(width) for width in config.hidden] if config.layer_norm else []
        self.norms = nn.ModuleList(norms)
        self.size = config.hidden[-1]

    def forward(self, features: Tensor) -> Tensor:
        if self.dense and isinstance(self.activation, nn.ELU) and not len(self.norms):
            return self._by_hand(features)
        return self._dense(features) if self.dense else self._plain(features)

    def _plain(self, hidden: Tensor) -> Tensor:
        for index, layer in enumerate(self.layers):
            hidden = self._activated(index, layer(hidden))
        return hidden

    def _dense(self, features: Tensor) -> Tensor:
        inputs = features.shape[1]
        wide = torch.cat([layer.weight[:, -inputs:] for layer in self.layers])
        bias = torch.cat([layer.bias for layer in self.layers])
        first, *shares = F.linear(features, wide, bias).split([len(layer.bias) for layer in self.layers], 1)
        hidden = self._activated(0, first)
        for index, share in enumerate(shares, 1):
            weight = self.layers[index].weight[:, :-inputs]
            hidden = self._activated(index, torch.addmm(share, hidden, weight.T))
        return hidden

    def _by_hand(self, features: Tensor) -> Tensor:
        """As :meth:`_dense`, in the precision of autocast where that is on: a tenth cheaper than by autograd."""
        if torch.is_autocast_enabled("cpu"):
            features = features.to(torch.get_autocast_dtype("cpu"))
        weights = [layer.weight for layer in self.layers]
        with torch.autocast("cpu", enabled=False):
            return _DenseELU.apply(features, *weights, *[layer.bias for layer in self.layers])  # type: ignore[no-any-return]

    def _activated(self, index: int, raw: Tensor) -> Tensor:
        return self.activation(self.norms[index](raw) if len(self.norms) else raw)


class _DenseELU(torch.autograd.Function):
    """``(features, *weights, *biases)`` of all layers to the last one's activations, in the features' precision."""

    @staticmethod
    def forward(ctx: Any, features: Tensor, *parameters: Tensor) -> Tensor:
        count, dtype, inputs = len(parameters) // 2, features.dtype, features.shape[1]
        weights, biases = parameters[:count], parameters[count:]
        wide = torch.cat([weight[:, -inputs:] for weight in weights]).to(dtype)
        heads = [weight[:, :-inputs].to(dtype) for weight in weights[1:]]
        raw = F.linear(features, wide, torch.cat(biases).to(dtype))
        hidden, *others = raw.split([len(bias) for bias in biases], 1)
        F.elu_(hidden)
        activations = [hidden]
        for share, head in zip(others, heads, strict=True):
            hidden = F.elu_(torch.addmm(share, hidden, head.T))
            activations.append(hidden)
        if count == 1:
            hidden = activations[0] = hidden.contiguous()
        ctx.count = count
        ctx.save_for_backward(features, wide, *heads, *activations)
        return hidden

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:  # type: ignore[override]
        features, wide, *saved = ctx.saved_tensors
        heads, activations = saved[: ctx.count - 1], saved[ctx.count - 1 :]
        widths = [part.shape[1] for part in activations]
        raw = features.new_empty(len(features), sum(widths))  # gradient before all activations
        parts = raw.split(widths, 1)
        own: list[Tensor] = []  # of the weights of hidden units, last layer first
        for index in range(ctx.count - 1, -1, -1):
            # the derivative from the result: 1 above zero, result + 1 below
            delta, known = parts[index], activations[index]
            torch.ops.aten.elu_backward(gradient, 1.0, 1.0, 1.0, True, known, grad_input=delta)
            if index:
                own.append(delta.T @ activations[index - 1])
                gradient = delta @ heads[index - 1]
        blocks = (raw.T @ features).split(widths)
        hidden = [blocks[0][:, :0], *reversed(own)]
        weights = [torch.cat(pair, 1) for pair in zip(hidden, blocks, strict=True)]
        inputs = raw @ wide if ctx.needs_input_grad[0] else None
        return inputs, *weights, *raw.sum(0).split(widths)
