"""Policy and value networks: D2RL perceptrons on normalised observations.

Every network reads ``ObservationFeatures``: the observation, normalised by running statistics shared by actor and
critics, with the shape slice passed through the encoding's learned layer where it has one (PointNet: 768 -> 64).
The features are the *last* columns of every weight matrix that reads them, so that a warm start can map columns.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn

from tactile_kit.agents.config import NetworkConfig
from tactile_kit.agents.trunk import Perceptron

CLIP = 5.0  # standard deviations, rl_games' clip of normalised observations
LOG_STD_MIN, LOG_STD_MAX = -5.0, 1.0  # of the squashed policy; beyond +1 the squashed Gaussian is bimodal


@dataclass(frozen=True)
class InputLayout:
    """What a network reads: ordered term names and sizes, and the learned shape layer.

    Attributes:
        terms: ``((name, size), ...)`` in the order of the observation.
        shape_layer: makes a module from the shape term's size to ``shape_size``, one for each network; or None.
        shape_size: size of the shape term behind ``shape_layer``.
    """

    terms: tuple[tuple[str, int], ...]
    shape_layer: Callable[[], nn.Module | None] | None = field(default=None, compare=False)
    shape_size: int | None = None

    @classmethod
    def of_env(cls, env) -> InputLayout:
        """The layout of a vector environment: its ``layout`` and, where it has one, its ``encoding``."""
        terms = tuple((str(name), int(size)) for name, size in env.layout.sizes.items())
        encoding = getattr(env, "encoding", None)
        return cls.of_encoding(terms, encoding)

    def without(self, names: Collection[str]) -> InputLayout:
        """The layout without its last terms ``names``. Raises ValueError where others follow them."""
        kept = tuple(term for term in self.terms if term[0] not in names)
        if kept != self.terms[: len(kept)]:
            raise ValueError(f"terms {sorted(names)} are not the last of {[name for name, _ in self.terms]}")
        return replace(self, terms=kept)

    @classmethod
    def of_encoding(cls, terms: tuple[tuple[str, int], ...], encoding) -> InputLayout:
        """The layout of observation terms whose shape term ``encoding`` (or None) made."""
        if encoding is None or encoding.size == encoding.observation_size:
            return cls(terms)
        return cls(terms, encoding.features, int(encoding.size))

    @property
    def size(self) -> int:
        return sum(size for _, size in self.terms)

    @property
    def shape_slice(self) -> slice | None:
        start = 0
        for name, size in self.terms:
            if name == "shape":
                return slice(start, start + size) if size else None
            start += size
        return None

    @property
    def features(self) -> tuple[tuple[str, int], ...]:
        """Names and sizes of the features behind the shape layer."""
        if self.shape_layer is None:
            return self.terms
        return tuple((name, self.shape_size if name == "shape" else size) for name, size in self.terms)  # type: ignore[misc]

    @property
    def features_size(self) -> int:
        return sum(size for _, size in self.features)


class RunningNorm(nn.Module):
    """Normalisation by running mean and standard deviation, clipped to ±5; the statistics are buffers.

    They change only through :meth:`update`, so that evaluation is frozen and a roll-out sees one normalisation.

    Args:
        size: D, entries of an observation.
        pooled: slice whose entries share one mean and deviation: point clouds, whose order and axes mean nothing.
    """

    mean: Tensor
    variance: Tensor
    count: Tensor
    shift: Tensor
    scale: Tensor

    def __init__(self, size: int, pooled: slice | None = None) -> None:
        super().__init__()
        self.pooled = pooled
        self.register_buffer("mean", torch.zeros(size, dtype=torch.float64))
        self.register_buffer("variance", torch.ones(size, dtype=torch.float64))
        # one count an entry: entries added by a warm start begin at zero
        self.register_buffer("count", torch.zeros(size, dtype=torch.float64))
        self.register_buffer("shift", torch.zeros(size), persistent=False)
        self.register_buffer("scale", torch.ones(size), persistent=False)
        self.register_load_state_dict_post_hook(lambda module, keys: module.refresh())

    @torch.no_grad()
    def update(self, observations: Tensor) -> None:
        """Take in a batch ``(B, D)`` (Chan et al.'s parallel update)."""
        mean, variance = _moments(observations)
        if self.pooled is not None:
            own = mean[self.pooled]
            variance[self.pooled] = variance[self.pooled].mean() + own.var(correction=0)
            mean[self.pooled] = own.mean()
        count = float(len(observations))
        total = self.count + count
        delta = mean - self.mean
        before = torch.where(self.count > 0, self.variance, torch.zeros_like(self.variance)) * self.count
        self.variance.copy_((before + variance * count + delta.square() * self.count * count / total) / total)
        self.mean.add_(delta * count / total)
        self.count.copy_(total)
        self.refresh()

    @torch.no_grad()
    def refresh(self) -> None:
        """Recompute the float32 shift and scale from the statistics."""
        scale = (self.variance + 1e-8).rsqrt()
        self.scale.copy_(scale)
        self.shift.copy_(-self.mean * scale)

    def forward(self, observations: Tensor) -> Tensor:
        return torch.addcmul(self.shift, observations, self.scale).clamp_(-CLIP, CLIP)


def _moments(observations: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and variance ``(D,) float64`` of a batch ``(B, D)``, in parts that stay in the cache."""
    parts = observations.split(512)
    mean = sum(part.sum(0, dtype=torch.float64) for part in parts) / len(observations)
    squares = sum((part - mean).square_().sum(0) for part in parts)
    return mean, squares / len(observations)  # type: ignore[return-value]


class ObservationFeatures(BaseFeaturesExtractor):
    """Observation ``(B, D)`` to features ``(B, F)``: normalisation, then the learned shape layer.

    Args:
        observation_space: Box ``(D,)``.
        layout: what the network reads: the observation, or its first terms.
        norm: the shared statistics, of the whole observation; None makes new ones.
    """

    def __init__(
        self, observation_space: spaces.Space, layout: InputLayout, norm: RunningNorm | None = None
    ) -> None:
        super().__init__(observation_space, layout.features_size)
        width = observation_space.shape[0]  # type: ignore[index]
        if width < layout.size or (norm is None and width != layout.size):
            raise ValueError(
                f"observation space {observation_space.shape} is not the layout's ({layout.size},)"
            )
        self.size = layout.size
        pooled = layout.shape_slice if layout.shape_layer is not None else None
        self.norm = norm if norm is not None else RunningNorm(layout.size, pooled)
        self.shape = layout.shape_layer() if layout.shape_layer is not None else None
        self.slice = layout.shape_slice

    def embed(self, normalised: Tensor) -> Tensor:
        """Features of observations that are normalised already; several networks share that work."""
        normalised = normalised[:, : self.size]
        if self.shape is None or self.slice is None:
            return normalised
        block = self.shape(normalised[:, self.slice])
        return torch.cat([normalised[:, : self.slice.start], block, normalised[:, self.slice.stop :]], dim=1)

    def forward(self, observations: Tensor) -> Tensor:
        return self.embed(self.norm(observations))


class GaussianPolicy(nn.Module):
    """The actor: mean and log standard deviation of the action, for PPO and for older agents of SAC.

    Args:
        features: the observation's features.
        actions: A, size of the action.
        config: layers.
        squashed: SAC's tanh-squashed Gaussian with a state-dependent sigma; otherwise PPO's with one parameter.
        log_std: initial log sigma.
        rest: ``(A,)`` action in [-1, 1] that an untrained policy takes on average (the mean grasp).
    """

    def __init__(
        self,
        features: ObservationFeatures,
        actions: int,
        config: NetworkConfig,
        *,
        squashed: bool,
        log_std: float = 0.0,
        rest: Sequence[float] | None = None,
    ) -> None:
        super().__init__()
        self.features = features
        self.squashed = squashed
        self.trunk = Perceptron(features.features_dim, config)
        self.mean = nn.Linear(self.trunk.size, actions)
        with torch.no_grad():
            self.mean.weight.mul_(0.01 * 3**0.5)  # nearly constant at first, as SB3's gain of 0.01
            self.mean.bias.zero_()
            if rest is not None:
                action = torch.as_tensor(rest, dtype=torch.float32).clamp(-0.98, 0.98)
                self.mean.bias.copy_(torch.atanh(action) if squashed else action)
        if squashed:
            self.log_std = nn.Linear(self.trunk.size, actions)
            with torch.no_grad():
                self.log_std.weight.mul_(0.1)
                self.log_std.bias.fill_(log_std)
        else:
            self.log_std = nn.Parameter(torch.full((actions,), float(log_std)))  # type: ignore[assignment]

    def moments(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Mean ``(B, A)`` and log sigma ``(B, A)`` or ``(A,)``, before squashing, float32."""
        latent = self.trunk(features)
        if self.squashed:
            return self.mean(latent).float(), self.log_std(latent).float().clamp(LOG_STD_MIN, LOG_STD_MAX)
        return _in_float32(self.mean, latent), self.log_std  # type: ignore[return-value]

    def act(self, observations: Tensor, noise: Tensor | None = None) -> Tensor:
        """Actions ``(B, A)`` in [-1, 1] for observations ``(B, D)``: the mode, or a sample for given noise."""
        mean, log_std = self.moments(self.features(observations))
        raw = mean if noise is None else mean + log_std.exp() * noise
        return torch.tanh(raw) if self.squashed else raw.clamp(-1.0, 1.0)


class ValueNetwork(nn.Module):
    """PPO's critic: observations ``(B, D)`` to values ``(B, 1)``."""

    def __init__(self, features: ObservationFeatures, config: NetworkConfig) -> None:
        super().__init__()
        self.features = features
        self.trunk = Perceptron(features.features_dim, config)
        self.head = nn.Linear(self.trunk.size, 1)

    def forward(self, observations: Tensor) -> Tensor:
        return self.embed(self.features(observations))

    def embed(self, features: Tensor) -> Tensor:
        return _in_float32(self.head, self.trunk(features))


def _in_float32(head: nn.Linear, latent: Tensor) -> Tensor:
    """PPO's small last layers: a mean's last bits count where sigma is small, a value's beside a step's reward."""
    with torch.autocast("cpu", enabled=False):
        return head(latent.float())
