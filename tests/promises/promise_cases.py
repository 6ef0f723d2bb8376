"""A run of the real task that takes seconds: nothing learned; and all that the shipped recipe uses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tactile_kit.ecrl import TactileVecEnv
from tactile_kit.runs import RunConfig
from tactile_kit.task.vec_env import ReorientVecEnv

LAYERS = {"hidden": (24, 16)}
LEARNER = {"actor": LAYERS, "critic": LAYERS, "rollout": 16, "minibatch": 32, "epochs": 2}
ESTIMATOR = {
    "encoder_hidden": (16,), "transition_hidden": (24,), "sigma_hidden": (8,),
    "features": 8, "latent": 6, "minibatch": 8,
}  # fmt: skip


def settings(kind: str, steps: int, **changes) -> RunConfig:
    """Settings of such a run, with changes as ``RunConfig.build`` takes them."""
    base = {
        "kind": kind,
        "steps": steps,
        "num_envs": 3,
        "ppo": LEARNER,
        "estimator": ESTIMATOR,
        "ecrl": {"rho_start": 0.9, "rho_step": 0.06, "rollout": 7},
        "task": {"objects": "cube,l_shape", "grasps": 2, "horizon": 12, "encoding": "bps"},
        "episodes": {"engine": "bullet", "drag": 0, "grasps": 2, "grasp_spread": 0.0},
        "gravity": {"start": 2.0, "end": 9.81, "steps": 500, "drops": 1.0, "geometric": False},
        "log_every": 48,
        "checkpoint": {"steps": 96, "minutes": 1e6},
        "evaluation": {"minutes": 0},
    }
    return RunConfig.preset("ppo-smoke", {**base, **changes})


# The recipe that ships, all that it uses switched on: steps of the filtered command, correlated noise, gravity that
# waits, lessons, stages of a tactile agent, a critic that sees the truth. Thick air is the compiled physics' own; the
# paper's cell learns in Bullet, the one that looks from the fingers in the compiled physics.
TEACHER = str(Path(__file__).parents[2] / "results/agents/oracle-vec_bps-geometric8-s0")
TAUGHT, FIXED, CRITIC = (
    240,
    96,
    192,
)  # environment steps: of lessons, without learning, and the critic's alone after them
EVERYTHING: dict[str, Any] = {
    "ppo": {
        **LEARNER, "noise_correlation": 0.6, "teacher": TEACHER, "taught_steps": TAUGHT, "fixed_steps": FIXED,
        "critic_steps": CRITIC,
    },
    "ecrl": {"rho_start": 0.9, "rho_step": 0.06, "rollout": 7, "critic_sees_truth": True},
    "task": {"objects": "cube,l_shape", "grasps": 2, "horizon": 12, "encoding": "bps", "action": "increment"},
    "gravity": {"start": 2.0, "end": 9.81, "steps": 500, "drops": 0.05, "geometric": True},
}  # fmt: skip
RECIPE: dict[str, dict[str, Any]] = {
    "bullet": {
        **EVERYTHING,
        "episodes": {"engine": "bullet", "drag": 0, "grasps": 2, "grasp_spread": 0.1},
    },
    "compiled": {
        **EVERYTHING,
        "episodes": {"engine": "compiled", "drag": 20, "grasps": 2, "grasp_spread": 0.1},
        "estimator": {**ESTIMATOR, "cell": "fingers", "loss": "pose"},
    },
}


def environment(config: RunConfig, workers: int) -> Any:
    """The run's environment with so many processes or threads (0: in this process)."""
    common = {"num_envs": config.num_envs, "num_workers": workers, "seed": 11}
    if config.kind == "oracle":
        return ReorientVecEnv(config.played, **common)
    return TactileVecEnv(config.played, **common, estimator=config.estimator, ecrl=config.ecrl)
