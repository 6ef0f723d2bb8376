"""Settings of the estimator. Defaults are those of the paper's website."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from tactile_kit.errors import EstimatorError, nearest
from tactile_kit.settings import WIDEST, Layers, Settings

PRESETS: dict[str, dict[str, object]] = {
    "paper": {},
    # For two CPU cores: the same recurrence with a tenth of the weights, and small minibatches.
    "small": {
        "encoder_hidden": (128, 128),
        "transition_hidden": (256, 256),
        "sigma_hidden": (64, 64),
        "minibatch": 128,
        "learning_rate": 1e-3,
        "bfloat16": True,
    },
}


class EstimatorConfig(Settings):
    """The estimator cell (paper, section II-D and figure 3), its loss and its optimiser.

    Layer sizes, optimiser and minibatch are the website's; what it leaves open says so.
    """

    cell: str = Field(
        default="paper",
        description="What the recurrence looks at: paper, or fingers (own; estimator/cells.py).",
    )
    loss: Literal["likelihood", "pose"] = Field(
        default="likelihood",
        description="The paper's, or plain distances of the pose with sigma beside them (own).",
    )
    encoding: str | None = Field(
        default=None,
        description="Shape encoding in the recurrence: none (no shape), bps (distances only) ...; null: the policy's.",
    )
    stop_gradient: bool = Field(
        default=False,
        description="Cut the gradient through the encoding in the recurrence (table II); the loss keeps its own.",
    )
    features: int = Field(default=32, ge=1, le=WIDEST, description="Outputs of the measurement encoder.")
    latent: int = Field(default=32, ge=1, le=WIDEST, description="Size of the latent state l.")
    encoder_hidden: Layers = Field(default=(512,) * 4, description="Hidden layers, encoder.")
    transition_hidden: Layers = Field(default=(512,) * 4, description="Hidden layers, transition.")
    sigma_hidden: Layers = Field(default=(256,) * 4, description="Hidden layers, sigma network.")
    learning_rate: float = Field(default=5e-4, gt=0, description="Adam's step size.")
    betas: tuple[float, float] = Field(default=(0.9, 0.99), description="Adam's averages.")
    weight_decay: float = Field(default=1e-5, ge=0, description="L2 penalty in Adam.")
    max_gradient_norm: float = Field(default=1.0, gt=0, description="Gradients are scaled down to this norm.")
    minibatch: int = Field(default=1024, ge=1, description="Sequences a gradient step.")
    bfloat16: bool = Field(
        default=False, description="Products of the transition in bfloat16 while it learns (sums in float32)."
    )
    averaging: float = Field(
        default=0.997,
        ge=0,
        lt=1,
        description="Weights act and are kept as their average over the gradient steps, the last ones by 1 - this; "
        "0: as they are (own choice).",
    )
    lost_angle: float = Field(
        default=1.0,
        gt=0,
        description="rad; estimates further off, or by lost_distance, begin a sequence of training near the truth.",
    )
    lost_distance: float = Field(default=0.05, gt=0, description="m, see lost_angle (own choice).")
    distance_unit: float = Field(
        default=0.01, gt=0, description="m, unit of shape distances in the likelihood (open in the paper)."
    )
    sigma_floor: float = Field(
        default=0.02,
        gt=0,
        description="Least sigma, in distance_unit and rad; keeps the likelihood bounded (open in the paper).",
    )

    @classmethod
    def preset(cls, name: str, **changes: object) -> EstimatorConfig:
        """Settings by name: ``paper`` (the website's) or ``small`` (two CPU cores), with fields changed.

        Raises EstimatorError for an unknown name.
        """
        if name not in PRESETS:
            raise EstimatorError(f"estimator preset {name!r} is unknown{nearest(name, PRESETS)}")
        return cls(**{**PRESETS[name], **changes})  # type: ignore[arg-type]
