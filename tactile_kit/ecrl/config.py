"""Settings of the coupling and the schedule of rho.

The paper's website gives the numbers rho_0, delta_rho, T and k and refers to earlier work for their meaning, which
could not be read. The readings chosen here: rho is the probability that ground truth stands in for the estimate in an
episode, and falls by delta_rho with each training of the estimator; k is how often each recorded sequence is used.
"""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import Field

from tactile_kit.settings import Settings


class ECRLConfig(Settings):
    """How policy and estimator are trained together (paper, section II-F; numbers from its website)."""

    rho_start: float = Field(
        default=1.0, ge=0, le=1, description="rho_0: first share of episodes with true poses."
    )
    rho_step: float = Field(
        default=5e-4, ge=0, le=1, description="delta_rho: fall of rho an iteration, down to 0."
    )
    critic_sees_truth: bool = Field(
        default=False,
        description="While training, PPO's critic sees the true state beside the belief (own choice).",
    )
    rollout: int = Field(
        default=32, ge=1, description="T: steps of a training sequence, and between trainings."
    )
    reuse: int = Field(
        default=4, ge=1, description="k: gradient steps that each recorded sequence takes part in."
    )
    kept: int = Field(
        default=4,
        ge=1,
        description="Roll-outs to draw from; 1 uses the newest k times over. More mix old and new, at the same work.",
    )


@dataclass(frozen=True)
class Schedule:
    """rho over the iterations: ``start`` falling by ``step`` each, never below 0."""

    start: float
    step: float

    def at(self, iteration: int) -> float:
        """rho in [0, 1] at an iteration >= 0."""
        return max(0.0, self.start - self.step * iteration)
