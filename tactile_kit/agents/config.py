"""Settings of the learner: networks and PPO. No torch here, so that ``--help`` is quick."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, PositiveFloat, PositiveInt

from tactile_kit.settings import Layers, Settings


class NetworkConfig(Settings):
    """One multi-layer perceptron."""

    hidden: Layers = (256, 256, 128)
    activation: Literal["elu", "relu", "silu"] = "elu"
    dense: bool = True  # D2RL: the input is concatenated to every hidden layer's input (Sinha et al. 2020)
    layer_norm: bool = False


class PPOConfig(Settings):
    """PPO as it turns objects on two cores; what the paper's website page says instead is the preset `ppo-paper`."""

    rollout: PositiveInt = Field(32, description="Vector steps between updates (the paper's T).")
    minibatch: int = Field(2048, ge=2, description="Transitions a gradient step; one alone has no spread.")
    epochs: PositiveInt = Field(2, description="Passes over a roll-out.")
    learning_rate: PositiveFloat = Field(1e-4, description="At the start; then adapted on the KL divergence.")
    learning_rate_bounds: tuple[PositiveFloat, PositiveFloat] = (1e-6, 1e-2)
    critic_learning_rate: PositiveFloat | None = Field(
        5e-4, description="The critic's own, which stays; None: it follows the actor's (rl_games)."
    )
    kl_threshold: PositiveFloat = 0.008
    clip: PositiveFloat = 0.2
    entropy: float = Field(1e-3, ge=0)
    gamma: float = Field(0.985, gt=0, le=1)
    gae_lambda: float = Field(0.95, ge=0, le=1)
    critic_coefficient: PositiveFloat = 4.0
    weight_decay: float = Field(1e-5, ge=0)
    max_gradient_norm: PositiveFloat = 1.0
    log_std: float = Field(-1.4, description="Initial log sigma of the actions, state-independent.")
    keep_sigma: bool = Field(True, description="A warm start takes over its source's sigma; false: log_std.")
    noise_correlation: float = Field(
        0.6, ge=0, lt=1, description="Correlation of the noise from one action to the next."
    )
    teacher: str | None = Field(None, description="Directory of an oracle agent that teaches at first.")
    taught_steps: int = Field(
        4_000_000,
        ge=0,
        description="Environment steps at the start in which the policy only follows its teacher.",
    )
    fixed_steps: int = Field(
        0,
        ge=0,
        description="Environment steps at the start in which the policy acts and nothing of it learns.",
    )
    critic_steps: int = Field(
        0, ge=0, description="Environment steps after them in which only the critic follows the roll-outs."
    )
    actor: NetworkConfig = NetworkConfig()
    critic: NetworkConfig = NetworkConfig()
    bfloat16: bool = Field(True, description="Matrix products of the update in bfloat16 (autocast).")
