"""The physics engines by name, and what each can do. How their parts are made: ``worlds`` and ``batches``."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass

from tactile_kit.errors import EngineError, nearest


@dataclass(frozen=True)
class Engine:
    """One physics engine.

    Attributes:
        worlds: whether it has worlds of a single episode; agents are evaluated in engines that do.
        evaluation_rate: physics steps a second of an evaluation, unless another is asked for.
        air: whether it has thick air.
        package, extra: what has to be installed beside the project, and what installs it; empty: nothing.
    """

    worlds: bool = True
    evaluation_rate: int = 0
    air: bool = False
    package: str = ""
    extra: str = ""

    @property
    def installed(self) -> bool:
        """Whether the engine can be used here."""
        return not self.package or importlib.util.find_spec(self.package) is not None

    def require(self) -> None:
        """Raises EngineError where the engine is not installed."""
        if not self.installed:
            raise EngineError(
                f"the package {self.package} is not installed; pip install 'tactile-kit[{self.extra}]' brings it"
            )


ENGINES: dict[str, Engine] = {
    # The finest step that a whole `make reproduce` affords; docs/physics.md has finer ones beside it.
    "bullet": Engine(evaluation_rate=120),
    "compiled": Engine(worlds=False, air=True),
    # The robot's controller runs at 1 kHz; this is the next multiple of the measurement rate.
    "mujoco": Engine(evaluation_rate=1020, package="mujoco", extra="transfer"),
}
WORLDS = tuple(name for name, engine in ENGINES.items() if engine.worlds)


def engine_of(name: str) -> Engine:
    """The engine of that name. Raises EngineError with the nearest one that there is."""
    if name not in ENGINES:
        raise EngineError(f"engine = {name!r} unknown{nearest(name, ENGINES)}")
    return ENGINES[name]
