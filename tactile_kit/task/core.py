"""What the single and the batched environment share: bodies, meshes, encoding, observation."""

from __future__ import annotations

import randomization
from tactile_kit.shape import MeshTable, encoding
from tactile_kit.simulation.bodies import Body
from tactile_kit.simulation.vector import Blueprint
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.observation import Observer, layout_of
from tactile_kit.task.variants import Variants, prepare


class Core:
    """Everything an environment derives from its settings once.

    Args:
        config: the task.
        sigma: whether the observation holds predicted uncertainties (tactile agents).
        variants: prepared bodies, where they are at hand already.
    """

    def __init__(self, config: TaskConfig, *, sigma: bool = False, variants: Variants | None = None) -> None:
        self.config = config
        self.preset = randomization.preset(config.randomization)
        self.variants = variants or prepare(config)
        self.meshes = MeshTable.from_meshes(
            [(thing.vertices, thing.faces) for thing in self.variants.objects],
            [f"object {thing.name!r}" for thing in self.variants.objects],
        )
        self.encoding = encoding(config.encoding, self.meshes)
        self.layout = layout_of(self.encoding, pose=config.pose_in_observation, sigma=sigma)
        self.observer = Observer(self.layout, self.encoding)
        self.blueprint = Blueprint(
            config.simulation,
            [Body(thing) for thing in self.variants.objects],
            self.variants.bank,
            self.preset,
            config.horizon,
        )
