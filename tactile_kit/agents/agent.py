"""A trained agent from its directory: policy, and for tactile agents the estimator. Needs no learner."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from pydantic import ValidationError

from tactile_kit.agents.manifest import Manifest, PolicyNetwork, read_manifest
from tactile_kit.agents.networks import GaussianPolicy, InputLayout, ObservationFeatures
from tactile_kit.errors import AgentError
from tactile_kit.files import read_tensors
from tactile_kit.settings import explain

if TYPE_CHECKING:
    from tactile_kit.task.config import TaskConfig
    from tactile_kit.task.variants import Variants

Module = TypeVar("Module", bound=torch.nn.Module)


@dataclass
class Agent:
    """A policy ready to act.

    Attributes:
        directory: where it was loaded from.
        manifest: agent.json.
        task: the task it was trained on.
        policy: the actor, in evaluation mode.
        estimator: cell of a tactile agent, or what stands in for it (:meth:`told_by`); None where the truth is seen.
    """

    directory: Path
    manifest: Manifest
    task: TaskConfig
    policy: GaussianPolicy
    estimator: Any | None = None

    @property
    def kind(self) -> str:
        return self.manifest.kind

    def told_by(self, estimator: Any) -> Agent:
        """The same policy, told what ``estimator`` believes: of another agent, or one that learns nothing.

        An oracle's policy is told poses alone, for it does not read uncertainties.
        """
        return replace(self, estimator=estimator)

    @torch.no_grad()
    def act(
        self,
        observations: NDArray[np.float32],
        deterministic: bool = True,
        rng: np.random.Generator | None = None,
    ) -> NDArray[np.float32]:
        """Actions ``(B, 12) float32`` in [-1, 1] for observations ``(B, D) float32``.

        Not deterministic means sampled with noise of ``rng``, which must then be given. Raises AgentError for
        observations of another width.
        """
        size = sum(size for _, size in self.manifest.layout)
        if observations.ndim != 2 or observations.shape[1] != size:
            raise AgentError(f"observations are {observations.shape}, the agent reads (B, {size})")
        noise = None
        if not deterministic:
            if rng is None:
                raise AgentError("sampling actions needs rng, a numpy Generator")
            noise = torch.from_numpy(
                rng.standard_normal((len(observations), self.manifest.network.actions), dtype=np.float32)
            )
        return self.policy.act(
            torch.from_numpy(np.ascontiguousarray(observations, np.float32)), noise
        ).numpy()

    def make_env(
        self,
        config: TaskConfig | None = None,
        num_envs: int = 8,
        num_workers: int = 1,
        seed: int = 0,
        episodes: Iterable | None = None,
        variants: Variants | None = None,
    ):
        """The environment this agent acts in, for evaluation: the true pose where it has no estimator, else the
        estimate (never the truth, no training). ``config`` defaults to the task it was trained on, ``variants`` to
        those of ``config``."""
        config = self.task if config is None else config
        if self.estimator is None:
            from tactile_kit.task.vec_env import ReorientVecEnv

            return ReorientVecEnv(
                config,
                num_envs=num_envs,
                num_workers=num_workers,
                seed=seed,
                episodes=episodes,
                variants=variants,
            )
        from tactile_kit.ecrl import TactileVecEnv

        reads = any(name == "sigma" for name, _ in self.manifest.layout)
        return TactileVecEnv(
            config.changed({"sigma_in_observation": reads}),
            num_envs=num_envs,
            num_workers=num_workers,
            seed=seed,
            episodes=episodes,
            variants=variants,
            estimator=self.estimator,
            training=False,
        )


def load_agent(directory: str | Path) -> Agent:
    """The agent in ``directory``.

    Networks are rebuilt from agent.json and filled from safetensors whose digests it names; nothing is unpickled.
    Raises AgentError naming file and reason when something is missing, damaged, newer or does not fit.
    """
    from tactile_kit.task.config import TaskConfig

    directory = Path(directory)
    manifest = read_manifest(directory)
    try:
        task = TaskConfig(**manifest.task)
    except ValidationError as problem:
        raise AgentError(f"{directory / 'agent.json'}: task: {explain(problem)}") from None
    layout = InputLayout.of_encoding(manifest.layout, _encoding(manifest.encoding, directory))
    path = directory / "policy.safetensors"
    tensors = read_tensors(path, manifest.weights[path.name], owner=manifest.identity)
    policy = filled(partial(build_policy, layout, manifest.network), tensors, directory)
    estimator = None
    if manifest.kind == "tactile":
        estimator = load_estimator(directory, manifest)
    return Agent(directory, manifest, task, policy.eval(), estimator)


def _encoding(name: str, directory: Path) -> Any:
    from tactile_kit.shape import kind_of

    try:
        return kind_of(name)
    except ValueError as problem:
        raise AgentError(f"{directory / 'agent.json'}: {problem}") from None


def build_policy(layout: InputLayout, network: PolicyNetwork) -> GaussianPolicy:
    """An actor of that layout and size."""
    space = spaces.Box(-np.inf, np.inf, (layout.size,), np.float32)
    return GaussianPolicy(
        ObservationFeatures(space, layout),
        network.actions,
        network.layers,
        squashed=network.squashed,
    )


def filled(build: Callable[[], Module], tensors: dict[str, torch.Tensor], where: Path) -> Module:
    """What ``build`` makes, with these weights: every name and shape as expected and every number finite.

    It is first built without memory, so that no size is allocated that is not in the weights; its initial weights come
    from no global generator. Raises AgentError.
    """
    with torch.random.fork_rng(devices=[]):
        try:
            with torch.device("meta"):
                wanted = build().state_dict()
        except RuntimeError as problem:  # more numbers than any machine has
            raise AgentError(f"{where}: no network can be built as agent.json says: {problem}") from None
        for name in [*wanted, *tensors]:
            found, expected = _kind(tensors.get(name)), _kind(wanted.get(name))
            if found != expected:
                raise AgentError(
                    f"{where}: weights do not fit the network of agent.json: {name!r} is {found}, expected {expected}"
                )
        for name, tensor in tensors.items():
            if tensor.is_floating_point() and not torch.isfinite(tensor).all():
                raise AgentError(f"{where}: weight {name!r} holds NaN or infinity")
        module = build()
    module.load_state_dict(tensors)
    return module


def _kind(tensor: torch.Tensor | None) -> str:
    return "not there" if tensor is None else f"{tuple(tensor.shape)} {tensor.dtype}"


def load_estimator(directory: Path, manifest: Manifest):
    """The estimator cell of a tactile agent's directory; raises AgentError."""
    from tactile_kit.estimator import EstimatorConfig, EstimatorError, cell_of

    path = directory / "estimator.safetensors"
    if manifest.estimator is None or path.name not in manifest.weights:
        raise AgentError(f"{directory / 'agent.json'}: a tactile agent without an estimator")
    try:
        config = EstimatorConfig(**manifest.estimator)
    except ValidationError as problem:
        raise AgentError(f"{directory / 'agent.json'}: estimator: {explain(problem)}") from None
    tensors = read_tensors(path, manifest.weights[path.name], owner=manifest.identity)
    build = partial(cell_of, config, _encoding(config.encoding or manifest.encoding, directory))
    try:
        return filled(build, tensors, path).eval()
    except EstimatorError as problem:
        raise AgentError(f"{directory / 'agent.json'}: {problem}") from None
