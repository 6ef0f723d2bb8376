"""A compiled physics of this hand and one object, for training: see docs/compiled.md."""

from tactile_kit.simulation.compiled.batch import Batch
from tactile_kit.simulation.compiled.engine import CompiledSimulation

__all__ = ["Batch", "CompiledSimulation"]
