"""Settings of the physics."""

from __future__ import annotations

import math

from pydantic import Field, model_validator

from randomization import STANDARD_GRAVITY
from tactile_kit.settings import Settings
from tactile_kit.simulation.engines import engine_of

MEASUREMENT_RATE = 60  # Hz, paper section II-C
CONTROL_RATE = 10  # Hz, the policy
SAMPLES = MEASUREMENT_RATE // CONTROL_RATE  # measurements a control step


def command_share(filter_time_constant: float) -> float:
    """Share of the way to a target that the filtered command has gone after a control step; time constant in s."""
    return 1.0 - math.exp(-1.0 / (CONTROL_RATE * filter_time_constant))


class SimulationConfig(Settings):
    """How Bullet integrates."""

    steps_per_second: int = Field(
        default=60,
        ge=60,
        le=6000,
        description="physics steps a second; a multiple of the 60 Hz measurement rate",
    )
    # Bullet's solver has converged by then for a grasped object; docs/physics.md shows what fewer would do.
    solver_iterations: int = Field(
        default=50, ge=4, le=500, description="most iterations of Bullet's constraint solver a physics step"
    )
    solver_residual: float = Field(
        default=0.0, ge=0, le=1, description="residual at which the solver stops before the last iteration"
    )
    filter_time_constant: float = Field(
        default=0.27, gt=0, le=2, description="time constant of the command low-pass filter, s"
    )

    # Agents are judged in Bullet, and in MuJoCo beside it; the compiled physics and its thick air are for training.
    engine: str = Field(default="bullet", description="bullet, compiled or mujoco (``engines``)")
    drag: float = Field(
        default=0.0,
        ge=0,
        le=100,
        description="thick air, compiled only: rate at which motion dies down without gravity, 1/s; fades as it rises",
    )

    def plain(self, steps_per_second: int | None = None, engine: str = "bullet") -> SimulationConfig:
        """These settings without thick air, as everything is measured; at another step where given."""
        step = self.steps_per_second if steps_per_second is None else steps_per_second
        return self.changed({"steps_per_second": step, "engine": engine, "drag": 0.0})

    def drag_under(self, gravity: float) -> float:
        """Rate (1/s) at which the object's speed and spin die down under ``gravity`` m/s^2, none at the earth's."""
        return self.drag * max(0.0, 1.0 - gravity / STANDARD_GRAVITY)

    @property
    def time_step(self) -> float:
        """Physics step, s."""
        return 1.0 / self.steps_per_second

    @property
    def steps_per_sample(self) -> int:
        """Physics steps between two measurements."""
        return self.steps_per_second // MEASUREMENT_RATE

    @model_validator(mode="after")
    def _whole_samples(self) -> SimulationConfig:
        if self.steps_per_second % MEASUREMENT_RATE:
            raise ValueError(
                f"simulation.steps_per_second = {self.steps_per_second}: allowed are multiples of {MEASUREMENT_RATE}"
            )
        return self

    @model_validator(mode="after")
    def _engine_with_air(self) -> SimulationConfig:
        if not engine_of(self.engine).air and self.drag:
            raise ValueError(
                f"simulation.drag = {self.drag:g}: {self.engine} has no thick air; allowed is 0 there"
            )
        return self
