"""The agent a run leaves behind: weights, agent.json and the model card."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from object_sets.storage import write_atomic
from tactile_kit.agents.manifest import Manifest, PolicyNetwork
from tactile_kit.files import (
    digest,
    json_bytes,
    replace_together,
    tensor_bytes,
)
from tactile_kit.runs.config import RunConfig
from tactile_kit.runs.directory import revision, versions

PAPER_STEPS = {"oracle": 1e9, "tactile": 1e10}  # orders of magnitude: 4096 environments for 7-11 and 60 hours


def export_agent(
    directory: Path,
    config: RunConfig,
    learner: Any,
    *,
    hours: float,
    training: dict[str, Any] | None = None,
    evaluation: dict[str, Any] | None = None,
    warm_start: dict[str, Any] | None = None,
    levelled: bool = False,
) -> Manifest:
    """Write policy, critic and, for tactile agents, estimator weights, then agent.json and README.md.

    Weights and agent.json change together: a kill at any moment leaves an agent that loads.
    """
    actor, critic = learner.policy.actor, learner.policy.critic
    parts = {"policy.safetensors": _own_tensors(actor), "critic.safetensors": critic.state_dict()}
    estimator = None
    if config.kind == "tactile":
        cell = learner.env.estimator
        estimator = cell.config.model_dump(mode="json")
        parts["estimator.safetensors"] = cell.state_dict()
    manifest = Manifest(
        schema=1,
        kind=config.kind,
        encoding=config.encoding,
        objects=config.objects,
        seed=config.seed,
        algorithm="ppo",
        steps=learner.num_timesteps,
        hours=round(hours, 4),
        levelled=levelled,
        warm_start=warm_start,
        layout=learner.input_layout.terms,
        task=config.task.model_dump(mode="json"),
        network=PolicyNetwork(
            layers=config.ppo.actor,
            squashed=actor.squashed,
            actions=int(learner.action_space.shape[0]),
        ),
        estimator=estimator,
        training=training or {},
        versions=versions(),
        git=revision(),
        weights=dict.fromkeys(parts, ""),
    )
    weights = {name: tensor_bytes(tensors, manifest.identity) for name, tensors in parts.items()}
    digests = {name: digest(data) for name, data in weights.items()}
    manifest = manifest.model_copy(update={"weights": digests})
    replace_together(directory, weights, "agent.json", json_bytes(manifest.to_json()))
    write_atomic(directory / "README.md", model_card(directory.name, manifest, evaluation).encode())
    return manifest


def _own_tensors(actor: Any) -> dict[str, Any]:
    """The actor's weights; of statistics that it shares with a critic that sees more, its own entries."""
    size = actor.features.size
    return {name: t[:size].clone() if ".norm." in name else t for name, t in actor.state_dict().items()}


def model_card(name: str, manifest: Manifest, evaluation: dict[str, Any] | None = None) -> str:
    """README.md of an agent: what it is, how much it was trained in plain words, how to use it."""
    sees = (
        "the true object pose from the simulator"
        if manifest.kind == "oracle"
        else "joint angles and control errors only; a learned estimator supplies the object pose"
    )
    lines = [
        f"# {name}",
        "",
        f"{'An' if manifest.kind == 'oracle' else 'A'} {manifest.kind} agent for in-hand reorientation with a "
        f"simulated four-fingered hand. It sees {sees}.",
        f"Shape encoding `{manifest.encoding}`, objects `{manifest.objects}`, seed {manifest.seed}.",
        "",
        "## Training",
        "",
        f"{manifest.steps:,} environment steps of {manifest.algorithm.upper()} in {manifest.hours:.2f} hours"
        f"{_origin(manifest.warm_start)}. {_amount(manifest)}",
        "",
    ]
    success = manifest.training.get("success")
    if success is not None:
        lines.append(
            f"At the end of training {success:.1%} of the last episodes succeeded (training goals, exploring policy)."
        )
    if evaluation:
        lines.append(
            f"Last held-out evaluation, at {evaluation['step']:,} steps: success rate "
            f"{evaluation['success_rate']:.3f} over {evaluation['episodes']} episodes (octahedral goals, full gravity)."
        )
    else:
        lines.append("It has not been evaluated on held-out episodes yet.")
    lines += [
        "",
        "## Use",
        "",
        "```python",
        "import tactile_kit",
        "",
        'agent = tactile_kit.load_agent("path/to/this/directory")',
        "actions = agent.act(observations)  # (B, D) float32 -> (B, 12) in [-1, 1]",
        "```",
        "",
        "Weights are safetensors; `agent.json` holds what is needed to build the networks, and the weights' digests.",
    ]
    return "\n".join(lines) + "\n"


def _origin(warm_start: dict[str, Any] | None) -> str:
    if not warm_start:
        return ", from scratch"
    return f", from the weights of `{warm_start['from']}` ({warm_start['steps']:,} steps before)"


def _amount(manifest: Manifest) -> str:
    steps = manifest.steps + (manifest.warm_start or {}).get("steps", 0)
    share = steps / PAPER_STEPS[manifest.kind]
    if steps < 1_000_000:
        return (
            "**This agent is barely trained**: enough to show that every part works, far too little to reorient "
            "objects. Its numbers say nothing about the method."
        )
    if share < 0.1:
        return (
            f"That is about {share:.1%} of what the paper's agents saw (of the order of "
            f"{PAPER_STEPS[manifest.kind]:.0e} steps)."
        )
    return "That is of the order of the paper's training."
