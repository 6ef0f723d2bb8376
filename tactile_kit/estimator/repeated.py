"""A ReLU perceptron that a recurrence applies T times, its weights' gradients summed by one product a layer.

Autograd alone would multiply T small matrices a layer and add T full-sized gradients up. Here every application keeps
its inputs and what comes back in rows of one array, and the products are taken once, over all rows together.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn
from torch.autograd.function import once_differentiable


class Repeated:
    """``net`` for ``steps`` applications to ``(B, n)`` inputs, within one graph.

    Calls beyond ``steps`` raise IndexError. Gradients reach the parameters once those of all applications are known.

    Args:
        net: linear layers with ReLU between them.
        steps, batch: T and B.
        bfloat16: products in that precision (sums in float32), as autocast would; otherwise in the weights' own.
    """

    def __init__(self, net: nn.Sequential, steps: int, batch: int, bfloat16: bool = False) -> None:
        layers = [layer for layer in net if isinstance(layer, nn.Linear)]
        parameters = [p for layer in layers for p in (layer.weight, layer.bias)]
        own = parameters[0].dtype
        self.dtype = torch.bfloat16 if bfloat16 else own
        self.weights = [layer.weight.detach().to(self.dtype) for layer in layers]
        self.biases = [layer.bias.detach().to(self.dtype) for layer in layers]
        self.out = own
        self.inputs = [torch.empty(steps, batch, w.shape[1], dtype=self.dtype) for w in self.weights]
        self.returned = [torch.empty(steps, batch, w.shape[0], dtype=self.dtype) for w in self.weights]
        self.used = 0
        self.token = _Weights.apply(self, *parameters)

    def __call__(self, x: Tensor) -> Tensor:
        """The perceptron's output ``(B, m)`` for ``x (B, n)``."""
        step, self.used = self.used, self.used + 1
        return _Application.apply(x, self.token, self, step)

    def forward(self, x: Tensor, step: int) -> Tensor:
        """Outputs of application ``step``; its layers' inputs are kept."""
        hidden = self.inputs[0][step].copy_(x)
        last = len(self.weights) - 1
        for index in range(last):
            hidden = torch.addmm(
                self.biases[index], hidden, self.weights[index].t(), out=self.inputs[index + 1][step]
            ).relu_()
        return torch.addmm(self.biases[last], hidden, self.weights[last].t()).to(self.out)

    def backward(self, gradient: Tensor, step: int, wanted: bool) -> Tensor | None:
        """The gradient of application ``step``'s input, where ``wanted``; what came back at each layer is kept."""
        back = self.returned[-1][step].copy_(gradient)
        for index in range(len(self.weights) - 1, 0, -1):
            product = torch.mm(back, self.weights[index])
            back = torch.ops.aten.threshold_backward.grad_input(
                product, self.inputs[index][step], 0, grad_input=self.returned[index - 1][step]
            )
        return torch.mm(back, self.weights[0]).to(self.out) if wanted else None

    def gradients(self) -> list[Tensor]:
        """Of weight and bias, layer by layer, over all applications made."""
        found = []
        for inputs, returned in zip(self.inputs, self.returned, strict=True):
            rows, back = inputs[: self.used].flatten(0, 1), returned[: self.used].flatten(0, 1)
            found += [torch.mm(back.t(), rows).to(self.out), back.sum(0, dtype=torch.float32).to(self.out)]
        return found


class _Weights(torch.autograd.Function):
    """A number without value that every application depends on, so that its backward pass comes after all of theirs."""

    @staticmethod
    def forward(ctx: Any, owner: Repeated, *parameters: Tensor) -> Tensor:
        ctx.owner = owner
        return torch.zeros(())

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Any, ...]:
        return (None, *ctx.owner.gradients())


class _Application(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, token: Tensor, owner: Repeated, step: int) -> Tensor:
        ctx.owner, ctx.step = owner, step
        return owner.forward(x.detach(), step)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Any, ...]:
        return ctx.owner.backward(gradient, ctx.step, ctx.needs_input_grad[0]), torch.zeros(()), None, None
