"""A run of the real task that takes seconds: everything switched on, nothing learned."""

from __future__ import annotations

from tactile_kit.runs import RunConfig

LAYERS = {"hidden": (24, 16)}
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
        "ppo": {"actor": LAYERS, "critic": LAYERS, "rollout": 16, "minibatch": 32, "epochs": 2},
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


# The recipe that ships: steps of the filtered command, and in the compiled physics thick air and gravity that waits.
RECIPE = {
    "bullet": {},
    "compiled": {
        "task": {"objects": "cube,l_shape", "grasps": 2, "horizon": 12, "encoding": "bps", "action": "increment"},
        "episodes": {"engine": "compiled", "drag": 20, "grasps": 2, "grasp_spread": 0.1},
        "gravity": {"start": 2.0, "end": 9.81, "steps": 500, "drops": 0.9, "geometric": True},
    },
}  # fmt: skip
