"""Starting from another agent's weights, also when the observation has grown.

Columns of input weights are matched by the observation's term names; terms the source did not have (an oracle's
successor gets sigma) start with zero columns, so the policy acts at first exactly as its predecessor did.
"""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor, nn

from tactile_kit.agents.agent import load_estimator
from tactile_kit.agents.manifest import Manifest, read_manifest
from tactile_kit.agents.networks import InputLayout
from tactile_kit.errors import AgentError
from tactile_kit.files import read_tensors
from tactile_kit.shape import kind_of

Terms = tuple[tuple[str, int], ...]


def column_map(old: Terms, new: Terms, changed: frozenset[str]) -> list[tuple[slice, slice]]:
    """Pairs (old columns, new columns) of terms of the same name and size, those in ``changed`` left out."""
    starts, start = {}, 0
    for name, size in old:
        starts[name] = (start, size)
        start += size
    pairs, start = [], 0
    for name, size in new:
        if name in starts and name not in changed and starts[name][1] == size:
            pairs.append((slice(starts[name][0], starts[name][0] + size), slice(start, start + size)))
        start += size
    return pairs


def transplant(
    module: nn.Module, source: dict[str, Tensor], old: InputLayout, new: InputLayout, changed: frozenset[str]
) -> list[str]:
    """Copy what fits of ``source`` into ``module``; returns the names of tensors left as initialised.

    Args:
        module: an actor or a critic of this package, reading ``new``.
        source: its state_dict when it read ``old``.
        changed: terms whose meaning differs although the size may not (another shape encoding).
    """
    state = module.state_dict()
    inputs = column_map(old.features, new.features, changed)
    entries = column_map(old.terms, new.terms, changed)
    left = []
    for name, target in state.items():
        given = source.get(name)
        if given is not None and given.dtype == target.dtype:
            if ".norm." in name and given.shape == (old.size,):
                for a, b in entries:
                    target[b] = given[a]
                continue
            if "shape" in changed and ".shape." in name:
                given = None
            elif _reads_features(name, given, target, old.features_size, new.features_size):
                head = (
                    given.shape[-1] - old.features_size
                )  # columns before the features: hidden units, actions
                fresh = torch.zeros_like(target)
                fresh[..., :head] = given[..., :head]
                for a, b in inputs:
                    fresh[..., head + b.start : head + b.stop] = given[..., head + a.start : head + a.stop]
                target.copy_(fresh)
                continue
            elif given.shape == target.shape:
                target.copy_(given)
                continue
        left.append(name)
    module.load_state_dict(state)
    return left


def _reads_features(name: str, given: Tensor, target: Tensor, old: int, new: int) -> bool:
    if (".layers." not in f".{name}" and not name.endswith("weights.0")) or given.ndim < 2:
        return False
    head = given.shape[-1] - old
    return head >= 0 and head == target.shape[-1] - new and given.shape[:-1] == target.shape[:-1]


def warm_start(learner, directory: str | Path, encoding: str) -> dict:
    """Fill a fresh learner from the agent in ``directory``; ``encoding`` is the learner's own.

    Returns what agent.json records of it: source, steps and hours it was trained for (with all that it started from
    itself) and the weights left as initialised. Raises AgentError when the directory is no valid agent or its actor's
    output means something else.
    """
    directory = Path(directory)
    manifest = read_manifest(directory)
    policy = learner.policy
    if manifest.network.squashed:
        raise AgentError(f"{directory}: its action mean passes a tanh, which this learner's does not")
    old = InputLayout.of_encoding(manifest.layout, kind_of(manifest.encoding))
    changed = frozenset() if manifest.encoding == encoding else frozenset({"shape"})
    tensors = read_tensors(directory / "policy.safetensors", manifest.weights["policy.safetensors"])
    left = [
        f"policy/{name}" for name in transplant(policy.actor, tensors, old, learner.input_layout, changed)
    ]
    if not learner.config.keep_sigma:
        policy.actor.log_std.data.fill_(learner.config.log_std)
    name = "critic.safetensors"
    if name in manifest.weights:
        tensors = read_tensors(directory / name, manifest.weights[name])
        missing = transplant(policy.critic, tensors, old, learner.critic_layout, changed)
        left += [f"critic/{name}" for name in missing]
    else:
        left.append("critic")
    cell = getattr(learner.env, "estimator", None)
    if cell is not None:
        left += _warm_estimator(cell, directory, manifest)
    before = manifest.warm_start or {}
    return {
        "from": directory.name,
        "steps": manifest.steps + int(before.get("steps", 0)),
        "hours": manifest.hours + float(before.get("hours", 0.0)),
        "as_initialised": left,
    }


def _warm_estimator(cell: nn.Module, directory: Path, manifest: Manifest) -> list[str]:
    """Copy the source's estimator where it has one of the same shape; otherwise name it as left."""
    if manifest.kind != "tactile":
        return ["estimator"]
    source = load_estimator(directory, manifest).state_dict()
    state = cell.state_dict()
    if {name: tensor.shape for name, tensor in source.items()} != {
        name: t.shape for name, t in state.items()
    }:
        return ["estimator"]
    cell.load_state_dict(source)
    return []
