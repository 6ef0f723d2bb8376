"""agent.json: what an agent is, and the digests of its weights."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError, field_validator

from tactile_kit.agents.config import NetworkConfig
from tactile_kit.errors import AgentError
from tactile_kit.files import read_json
from tactile_kit.settings import Settings, explain

SCHEMA = 1
WEIGHTS = ("policy.safetensors", "critic.safetensors", "estimator.safetensors")


class PolicyNetwork(Settings):
    """What is needed to build the actor again."""

    layers: NetworkConfig
    squashed: bool
    actions: int = Field(12, ge=1)


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
    layout: tuple[tuple[str, int], ...]
    task: dict[str, Any]
    network: PolicyNetwork
    estimator: dict[str, Any] | None = None
    training: dict[str, Any] = Field(default_factory=dict, description="Last smoothed figures of training.")
    versions: dict[str, str] = Field(default_factory=dict)
    git: str | None = None
    weights: dict[str, str]

    @field_validator("weights")
    @classmethod
    def _known_files(cls, weights: dict[str, str]) -> dict[str, str]:
        unknown = sorted(set(weights) - set(WEIGHTS))
        if unknown:
            raise ValueError(f"weight files {unknown}; allowed: {list(WEIGHTS)}")
        if "policy.safetensors" not in weights:
            raise ValueError("no digest of policy.safetensors")
        return weights

    def to_json(self) -> dict[str, Any]:
        """Plain data for agent.json."""
        return self.model_dump(mode="json", by_alias=True)


def read_manifest(directory: Path) -> Manifest:
    """The checked manifest of an agent directory; raises AgentError naming the file and what is wrong."""
    path = directory / "agent.json"
    data = read_json(path)
    if data.get("schema") != SCHEMA:
        raise AgentError(f"{path}: schema {data.get('schema')!r}, this version reads {SCHEMA}")
    try:
        return Manifest(**data)
    except ValidationError as problem:
        raise AgentError(f"{path}: {explain(problem)}") from None
