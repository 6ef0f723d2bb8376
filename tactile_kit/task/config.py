"""Settings of the reorientation task: one frozen tree, from which everything else follows."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from tactile_kit.settings import Settings
from tactile_kit.simulation.config import SimulationConfig


class RewardConfig(Settings):
    """Coefficients of the paper's reward (section II-E)."""

    rotation: float = Field(
        default=1.0, ge=0, description="weight of the angle gained towards the goal, 1/rad"
    )
    rotation_clip: float = Field(default=0.1, gt=0, description="most angle rewarded in a step, rad")
    position: float = Field(
        default=8.0, ge=0, description="weight of the growing distance from the start, 1/m"
    )
    posture: float = Field(
        default=1 / 6, ge=0, description="weight of the fourth power of joint deviation, 1/rad^4"
    )
    drop: float = Field(
        default=0.0, ge=0, description="price of a drop; the paper has none beside the position's"
    )
    arrival: float = Field(
        default=0.0,
        ge=0,
        description="weight of coming within some 0.5 rad of the goal, all in all; the paper has none",
    )


class TaskConfig(Settings):
    """Reorient an object in the hand within ``horizon`` actions of 0.1 s."""

    objects: str = Field(default="geometric8", description="sets, names or ids, separated by commas")
    scaling: Literal["nominal", "random"] = Field(
        default="nominal", description="random: extents drawn an axis"
    )
    variants: int = Field(
        default=16, ge=1, le=1024, description="prepared sizes an object under random scaling"
    )
    variant_seed: int = Field(default=0, ge=0, description="seed of the prepared sizes")
    extent_range: tuple[float, float] = Field(
        default=(0.045, 0.09), description="extents under random scaling, m"
    )
    encoding: str = Field(default="vec_bps", description="shape encoding, see tactile_kit.shape.ENCODINGS")
    pose_in_observation: bool = Field(
        default=True,
        description="add the 9 pose numbers beside a BPS or point cloud encoding (the paper's website)",
    )
    sigma_in_observation: bool = Field(
        default=True, description="tactile agents: add the predicted uncertainties"
    )
    randomization: str = Field(default="default", description="preset or YAML file of domain randomisation")
    gravity: float = Field(default=9.81, ge=0, le=30, description="m/s^2; curricula set it lower for a while")
    goals: Literal["so3", "octahedral"] = Field(default="so3", description="where goals are drawn from")
    horizon: int = Field(default=100, ge=1, le=10000, description="actions an episode, 0.1 s each")
    success_angle: float = Field(default=0.4, gt=0, description="largest final angle of a success, rad")
    action: Literal["absolute", "increment"] = Field(
        default="absolute",
        description="target joint angles, or steps from the filtered command",
    )
    grasps: int = Field(default=8, ge=1, le=1000, description="initial grasps a variant")
    grasp_spread: float = Field(
        default=0.0,
        ge=0,
        le=0.5,
        description="how far grasps stray from the heuristic's posture, rad (training)",
    )
    reward: RewardConfig = RewardConfig()
    simulation: SimulationConfig = SimulationConfig()

    @model_validator(mode="after")
    def _check(self) -> TaskConfig:
        import randomization

        low, high = self.extent_range
        if not 0.02 <= low <= high <= 0.15:
            raise ValueError(f"extent_range = {self.extent_range}: allowed is 0.02 <= low <= high <= 0.15 m")
        randomization.preset(self.randomization)  # an unknown name or a faulty file is an error here already
        return self
