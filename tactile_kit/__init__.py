"""tactile-kit: purely tactile, shape-conditioned in-hand manipulation, reproducible on a plain CPU.

``gymnasium.make("tactile_kit/Reorient-v0")``, ``tactile_kit.make_vec``, ``tactile_kit.load_agent`` and
``tactile_kit.evaluate`` are the ways in; nothing heavier than Gymnasium is imported before one
of them is used.
"""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path
from typing import Any

__version__ = "0.1.0"

_WAYS_IN = {
    "make_vec": "tactile_kit.task.vec_env",
    "load_agent": "tactile_kit.agents",
    "evaluate": "tactile_kit.evaluation",
    "TaskConfig": "tactile_kit.task.config",
}
ENVIRONMENT = "tactile_kit/Reorient-v0"

__all__ = ["ENVIRONMENT", "TaskConfig", "__version__", "evaluate", "load_agent", "make_vec", "register"]


def __getattr__(name: str) -> Any:
    if name in _WAYS_IN:
        return getattr(import_module(_WAYS_IN[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _place_compiled_code() -> None:
    """numba keeps what it compiled beside the source, else in the user's home; in a container it may have neither."""
    if "NUMBA_CACHE_DIR" not in os.environ and not os.access(Path(__file__).parent, os.W_OK):
        from object_sets.storage import cache_directory

        os.environ["NUMBA_CACHE_DIR"] = str(cache_directory() / "numba")


def register() -> None:
    """Tell Gymnasium of the environment; importing the package has done it already."""
    import gymnasium

    if ENVIRONMENT not in gymnasium.registry:
        # the task ends its episodes itself, at the horizon
        gymnasium.register(ENVIRONMENT, entry_point="tactile_kit.task.env:ReorientEnv")


_place_compiled_code()
register()
