"""What a job asks a cluster for: cores, memory and time, from its settings and from what was measured.

The costs are those of one core of an AMD EPYC, from ``results/benchmarks`` (a test compares them); learners are scaled
by their weights, samples and passes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

MARGIN = 2.0  # other processors, neighbours on the node, a slow file system
LEAST = 20  # minutes: loading, compiling, a slow start

# memory, MB
PARENT = 1200.0  # libraries, kernels, learner
WORKER, ENVIRONMENT = 216.0, 29.0  # in Bullet: a worker with its first environment, each further one
SAMPLE = 0.02  # of a roll-out: observations of policy, critic and estimator, and what updates make of them

# µs of one core, for one environment step
BULLET, COMPILED = 842.0, 18.7  # simulated, in the workers
PARENTS = 37.0  # in the parent: observation with its encoding, reward, episodes
# for a million weights
POLICY = 58.0  # the policy and the critic, as they act
LEARNER = 92.0  # one pass of theirs over the samples, forward and back
ESTIMATES = 31.5  # the estimator, as it acts
ESTIMATOR = 36.6  # one pass of its over the sequences
EPISODE = 0.15  # s of one core: a whole evaluated episode of up to 100 steps
GRASPS = 3.0  # s of one core: the grasps of one object at one size


@dataclass(frozen=True)
class Need:
    """What one job asks for."""

    threads: int
    mem_mb: int
    minutes: int

    def __or__(self, other: Need) -> Need:
        """Of one job that does both, one after the other."""
        return Need(
            max(self.threads, other.threads), max(self.mem_mb, other.mem_mb), self.minutes + other.minutes
        )

    @property
    def as_dict(self) -> dict[str, int]:
        return asdict(self)


def training(config: Mapping[str, Any]) -> Need:
    """Of a training, by its resolved ``RunConfig``."""
    workers, threads = int(config["num_workers"]), int(config["threads"])
    minutes = step_microseconds(config) * int(config["steps"]) / 60e6
    rollout = int(config["num_envs"]) * int(config["ppo"]["rollout"])
    memory = PARENT + SAMPLE * rollout
    if not _compiled(config):
        memory += _worlds(int(config["num_envs"]), workers)
    return Need(max(workers, threads), math.ceil(memory), _limit(minutes))


class Parts(NamedTuple):
    """µs of wall time for one environment step; the three take turns."""

    simulated: float  # on all workers
    parent: float  # on one core
    learner: float  # on its threads


def step_parts(config: Mapping[str, Any]) -> Parts:
    """What one environment step of a training costs, by its resolved ``RunConfig``."""
    tactile = config["kind"] == "tactile"
    ppo, threads = config["ppo"], int(config["threads"])
    weights = sum(_weights(ppo[name]["hidden"]) for name in ("actor", "critic"))
    parent, learner = PARENTS + POLICY * weights, LEARNER * ppo["epochs"] * weights
    if tactile:
        names = ("encoder_hidden", "transition_hidden", "sigma_hidden")
        weights = sum(_weights(config["estimator"][name]) for name in names)
        learner += ESTIMATOR * config["ecrl"]["reuse"] * weights
        parent += ESTIMATES * weights
    simulated = COMPILED if _compiled(config) else BULLET
    return Parts(simulated / int(config["num_workers"]), parent, learner / threads)


def step_microseconds(config: Mapping[str, Any]) -> float:
    """Wall time of one environment step."""
    return sum(step_parts(config))


INPUTS = 353  # the largest observation; smaller ones change little


def _weights(hidden: list[int]) -> float:
    """Of a network, in millions."""
    return sum(before * after for before, after in zip([INPUTS, *hidden], hidden, strict=False)) / 1e6


def _compiled(config: Mapping[str, Any]) -> bool:
    engine = config["episodes"].get("engine") or config["task"]["simulation"]["engine"]
    return engine == "compiled"


def evaluation(episodes: int, environments: int, workers: int) -> Need:
    """Of an evaluation in Bullet, or an engine of its speed."""
    memory = PARENT + _worlds(environments, workers)
    return Need(workers, math.ceil(memory), _limit(EPISODE * episodes / workers / 60))


def grasps(sizes: int, workers: int) -> Need:
    """Of the search for grasps of so many objects and sizes."""
    return Need(
        workers, math.ceil(PARENT + workers * (WORKER + ENVIRONMENT)), _limit(GRASPS * sizes / workers / 60)
    )


def _worlds(environments: int, workers: int) -> float:
    return workers * WORKER + ENVIRONMENT * max(environments - workers, 0)


def _limit(minutes: float) -> int:
    return LEAST + math.ceil(MARGIN * minutes)
