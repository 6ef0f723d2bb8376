"""agent.json: what an agent is, and the digests of its weights."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PrivateAttr, ValidationError, field_validator, model_validator

from tactile_kit.agents.config import NetworkConfig
from tactile_kit.errors import AgentError
from tactile_kit.files import digest, read_json
from tactile_kit.settings import Settings, explain

SCHEMA = 1
DECIDES = ("kind", "encoding", "objects", "seed", "layout", "task", "network", "estimator")
LARGEST = 1_000_000  # numbers of an observation
WEIGHTS = ("policy.safetensors", "critic.safetensors", "estimator.safetensors")


class PolicyNetwork(Settings):
    """What is needed to build the actor again."""

    layers: NetworkConfig
    squashed: bool
    actions: int = Field(12, ge=1, le=1000)


class Manifest(Settings):
    """The contents of agent.json (schema 1)."""

    schema_version: int = Field(SCHEMA, alias="schema")
    kind: Literal["oracle", "tactile"]
    encoding: str
    objects: str
    seed: int
    algorithm: Literal["ppo", "sac"]
    steps: int = Field(ge=0, description="Environment steps trained, in this run.")
    hours: float = Field(ge=0, description="Wall time trained, in this run.")
    levelled: bool = Field(False, description="Whether training ended because success no longer rose.")
    warm_start: dict[str, Any] | None = Field(
        None, description="Where the weights came from, with its steps."
    )
    layout: tuple[tuple[str, Annotated[int, Field(ge=0, le=LARGEST)]], ...] = Field(max_length=100)
    task: dict[str, Any]
    network: PolicyNetwork
    estimator: dict[str, Any] | None = None
    training: dict[str, Any] = Field(default_factory=dict, description="Last smoothed figures of training.")
    versions: dict[str, str] = Field(default_factory=dict)
    git: str | None = None
    weights: dict[str, str]
    _identity: str = PrivateAttr("")

    @field_validator("weights")
    @classmethod
    def _known_files(cls, weights: dict[str, str]) -> dict[str, str]:
        unknown = sorted(set(weights) - set(WEIGHTS))
        if unknown:
            raise ValueError(f"weight files {unknown}; allowed: {list(WEIGHTS)}")
        if "policy.safetensors" not in weights:
            raise ValueError("no digest of policy.safetensors")
        return weights

    @model_validator(mode="after")
    def _of_one_mind(self) -> Manifest:
        size = sum(size for _, size in self.layout)
        if size > LARGEST:
            raise ValueError(f"layout of {size:,} numbers: allowed are {LARGEST:,}")
        for name in ("encoding", "objects"):
            said = self.task.get(name, getattr(self, name))
            if said != getattr(self, name):
                raise ValueError(
                    f"{name} {getattr(self, name)!r} where task.{name} is {said!r}: allowed is the same"
                )
        return self

    @property
    def identity(self) -> str:
        """Digest of all that says what the weights are of, as it stands in the file; they name it too.

        So nothing of it can be altered alone, and evaluations be called another agent's.
        """
        return self._identity or identity_of(self.to_json())

    def to_json(self) -> dict[str, Any]:
        """Plain data for agent.json."""
        return self.model_dump(mode="json", by_alias=True)


def identity_of(data: Mapping[str, Any]) -> str:
    """See :attr:`Manifest.identity`; ``data`` is what agent.json holds."""
    said = {name: data.get(name) for name in DECIDES}
    return digest(json.dumps(said, sort_keys=True, allow_nan=False).encode())


def read_manifest(directory: Path) -> Manifest:
    """The checked manifest of an agent directory; raises AgentError naming the file and what is wrong."""
    path = directory / "agent.json"
    data = read_json(path)
    if data.get("schema") != SCHEMA:
        raise AgentError(f"{path}: schema {data.get('schema')!r}, this version reads {SCHEMA}")
    try:
        manifest = Manifest(**data)
        manifest._identity = identity_of(data)
    except ValidationError as problem:
        raise AgentError(f"{path}: {explain(problem)}") from None
    except (TypeError, ValueError, RecursionError) as problem:
        raise AgentError(f"{path}: {problem}") from None
    return manifest
