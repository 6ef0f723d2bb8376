"""Domain randomisation as data: named distributions with unit and range, presets, and reproducible sampling.

``preset("default").draw("episode", seed)`` gives the physical parameters of an episode; ``replay`` brings
recorded ones back. ``stream`` and ``derive`` are the only source of random numbers in the project.
"""

from randomization.distributions import (
    Bernoulli,
    Constant,
    Direction,
    Distribution,
    LogUniform,
    Normal,
    Uniform,
)
from randomization.errors import RandomizationError, SeedError
from randomization.files import PRESETS, preset, read_randomization, write_randomization
from randomization.gravity import STANDARD_GRAVITY, GravitySchedule
from randomization.sampling import Randomization, Term
from randomization.scaling import scaled
from randomization.streams import derive, stream

__all__ = [
    "PRESETS",
    "STANDARD_GRAVITY",
    "Bernoulli",
    "Constant",
    "Direction",
    "Distribution",
    "GravitySchedule",
    "LogUniform",
    "Normal",
    "Randomization",
    "RandomizationError",
    "SeedError",
    "Term",
    "Uniform",
    "derive",
    "preset",
    "read_randomization",
    "scaled",
    "stream",
    "write_randomization",
]
