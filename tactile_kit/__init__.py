"""tactile-kit: purely tactile, shape-conditioned in-hand manipulation, reproducible on a plain CPU.

``gymnasium.make("tactile_kit/Reorient-v0")``, ``tactile_kit.make_vec``, ``tactile_kit.load_agent`` and
``tactile_kit.evaluate`` are the ways in; nothing heavier than Gymnasium is imported before one
of them is used.
"""

from __future__ import annotations

import os
from pathlib import Path

from tactile_kit.lazy import on_first_use

__version__ = "0.1.0"

_WAYS_IN = {
    "make_vec": ".task.vec_env",
    "load_agent": ".agents",
    "evaluate": ".evaluation",
    "TaskConfig": ".task.config",
}
ENVIRONMENT = "tactile_kit/Reorient-v0"

__all__ = ["ENVIRONMENT", "TaskConfig", "__version__", "evaluate", "load_agent", "make_vec", "register"]


__getattr__ = on_first_use(__name__, _WAYS_IN)


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
