"""Networks: normalisation, D2RL wiring, the learned shape layer."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from gymnasium import spaces

from tactile_kit.agents.config import NetworkConfig
from tactile_kit.agents.networks import (
    GaussianPolicy,
    InputLayout,
    ObservationFeatures,
    Perceptron,
    RunningNorm,
)
from tactile_kit.shape import ENCODINGS

PAPER = (512, 512, 256, 128)
PLAIN = InputLayout((("joints", 4), ("goal", 6), ("shape", 3)))


def features(layout: InputLayout) -> ObservationFeatures:
    return ObservationFeatures(spaces.Box(-np.inf, np.inf, (layout.size,), np.float32), layout)


def test_norm_matches_statistics_of_everything_seen() -> None:
    rng = np.random.default_rng(0)
    data = rng.normal([3.0, -0.01, 1e3], [0.5, 1e-3, 40.0], (700, 3)).astype(np.float32)
    norm = RunningNorm(3)
    for part in np.array_split(data, 13):
        norm.update(torch.from_numpy(part))
    np.testing.assert_allclose(norm.mean, data.astype(np.float64).mean(0), rtol=1e-12)
    np.testing.assert_allclose(norm.variance, data.astype(np.float64).var(0), rtol=1e-9)
    # tenths of a micron of deviation are kept apart from zero by the floor of 1e-4, hence the loose bound
    out = norm(torch.from_numpy(data))
    assert out.mean(0).abs().max() < 1e-2 and (out.std(0) - 1).abs().max() < 2e-2


def test_norm_clips_and_is_frozen_but_for_update() -> None:
    norm = RunningNorm(2)
    norm.update(torch.randn(100, 2, generator=torch.Generator().manual_seed(0)))
    before = {name: tensor.clone() for name, tensor in norm.state_dict().items()}
    assert norm(torch.tensor([[1e6, -1e6]])).tolist() == [[5.0, -5.0]]
    norm.train()
    norm(torch.randn(10, 2))
    assert all(torch.equal(before[name], tensor) for name, tensor in norm.state_dict().items())


def test_norm_survives_a_state_dict() -> None:
    norm, other = RunningNorm(4), RunningNorm(4)
    norm.update(torch.randn(50, 4) * 7 + 3)
    other.load_state_dict(norm.state_dict())
    x = torch.randn(5, 4)
    assert torch.equal(norm(x), other(x))


def test_pooled_entries_share_their_statistics() -> None:
    norm = RunningNorm(5, pooled=slice(2, 5))
    data = torch.randn(200, 5, generator=torch.Generator().manual_seed(1)) * torch.tensor([1, 1, 1, 5, 9.0])
    for part in data.split(50):
        norm.update(part)
    assert torch.unique(norm.mean[2:]).numel() == 1 and torch.unique(norm.variance[2:]).numel() == 1
    assert math.isclose(float(norm.variance[2]), float(data[:, 2:].double().var(correction=0)), rel_tol=1e-9)


def test_d2rl_concatenates_the_input_to_every_hidden_layer() -> None:
    net = Perceptron(353, NetworkConfig(hidden=PAPER))
    assert [layer.in_features for layer in net.layers] == [353, 512 + 353, 512 + 353, 256 + 353]
    assert [layer.out_features for layer in net.layers] == [512, 512, 256, 128]
    assert isinstance(net.activation, torch.nn.ELU)
    plain = Perceptron(353, NetworkConfig(hidden=PAPER, dense=False))
    assert [layer.in_features for layer in plain.layers] == [353, 512, 512, 256]


def test_d2rl_against_a_loop_by_hand() -> None:
    torch.manual_seed(0)
    net, x = Perceptron(5, NetworkConfig(hidden=(7, 6))), torch.randn(3, 5)
    first = torch.nn.functional.elu(x @ net.layers[0].weight.T + net.layers[0].bias)
    second = torch.nn.functional.elu(torch.cat([first, x], 1) @ net.layers[1].weight.T + net.layers[1].bias)
    torch.testing.assert_close(net(x), second)


def concatenating(net: Perceptron, features: torch.Tensor) -> torch.Tensor:
    """The obvious form: the input beside the hidden units of every layer."""
    hidden = features
    for index, layer in enumerate(net.layers):
        hidden = layer(torch.cat([hidden, features], 1) if net.dense and index else hidden)
        hidden = net.activation(net.norms[index](hidden) if len(net.norms) else hidden)
    return hidden


@pytest.mark.parametrize("hidden", [(9,), (9, 8), (32, 24, 16)])
@pytest.mark.parametrize(
    "settings", [{}, {"activation": "relu"}, {"activation": "silu", "layer_norm": True}, {"dense": False}]
)
def test_d2rl_equals_its_concatenating_twin(hidden: tuple[int, ...], settings: dict) -> None:
    """Values, and gradients of weights, biases and input, in float64."""
    torch.manual_seed(0)
    net = Perceptron(7, NetworkConfig(hidden=hidden, **settings)).double()
    x, weights = torch.randn(11, 7, dtype=torch.float64, requires_grad=True), torch.randn(11, hidden[-1])
    found, wanted = net(x), concatenating(net, x)
    torch.testing.assert_close(found, wanted)
    wrt = [x, *net.parameters()]
    for ours, theirs in zip(
        torch.autograd.grad((found * weights).sum(), wrt),
        torch.autograd.grad((wanted * weights).sum(), wrt),
        strict=True,
    ):
        torch.testing.assert_close(ours, theirs)


def test_d2rl_in_bfloat16_is_as_near_as_its_concatenating_twin() -> None:
    torch.manual_seed(0)
    net, x = Perceptron(50, NetworkConfig(hidden=(64, 48))), torch.randn(256, 50)
    exact = net(x)
    gradient = torch.randn_like(exact)
    errors = []
    for form in (net, lambda features: concatenating(net, features)):
        with torch.autocast("cpu", torch.bfloat16):
            found = form(x)
        assert found.dtype == torch.bfloat16
        slopes = torch.autograd.grad(found, list(net.parameters()), gradient.bfloat16())
        right = torch.autograd.grad(exact, list(net.parameters()), gradient, retain_graph=True)
        assert all(slope.dtype == torch.float32 for slope in slopes)
        parts = [(slope - fine).norm() / fine.norm() for slope, fine in zip(slopes, right, strict=True)]
        errors.append([(found - exact).norm() / exact.norm(), *parts])
    for ours, theirs in zip(*errors, strict=True):
        assert 0 < ours < 1.5 * theirs + 1e-3 and ours < 0.03


@pytest.mark.parametrize("rows", [16, 100, 512])
def test_a_row_in_bfloat16_is_the_same_in_any_batch(rows: int) -> None:
    """PPO compares means of its roll-outs with those of its minibatches, bit for bit."""
    torch.manual_seed(0)
    layout = InputLayout((("joints", 144), ("goal", 6), ("shape", 192), ("pose", 9)))
    actor = GaussianPolicy(features(layout), 12, NetworkConfig(hidden=(256, 256, 128)), squashed=False)
    x, order = torch.randn(2048, layout.size).bfloat16(), torch.randperm(2048)[:rows]
    with torch.no_grad(), torch.autocast("cpu", torch.bfloat16):
        assert torch.equal(actor.moments(x)[0][order], actor.moments(x[order])[0])


@pytest.mark.parametrize("name", sorted(ENCODINGS))
def test_learned_shape_layer_stands_where_the_encoding_has_one(name: str) -> None:
    encoding = ENCODINGS[name]
    terms = [("joints", 4), ("goal", 6)]
    if encoding.observation_size:
        terms.append(("shape", encoding.observation_size))
    terms.append(("pose", 9))

    extractor = features(InputLayout.of_encoding(tuple(terms), encoding))
    out = extractor(torch.randn(3, sum(size for _, size in terms)))
    assert out.shape == (3, 4 + 6 + encoding.size + 9) == (3, extractor.features_dim)
    assert (extractor.shape is not None) == (encoding.size != encoding.observation_size)


def test_rest_action_is_what_an_untrained_policy_takes() -> None:
    rest = (0.3, -0.9)
    for squashed in (True, False):
        policy = GaussianPolicy(features(PLAIN), 2, NetworkConfig(hidden=(16,)), squashed=squashed, rest=rest)
        actions = policy.act(torch.randn(50, PLAIN.size))
        assert (actions - torch.tensor(rest)).abs().max() < 0.05
