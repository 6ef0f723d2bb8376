"""Jobs of the workflow on other machines: Snakemake decides what runs, this hands it to a scheduler and follows it.

Snakemake's executor is ``cluster-generic``, which calls ``python -m reproduce.clusters SCHEDULER SCRIPT`` for each job.
What is known of a job is in files below ``<pipeline>/cluster``: the next run finds the jobs of one that is gone.
"""

from __future__ import annotations

from reproduce.clusters.scheduler import Scheduler
from reproduce.errors import ReproduceError
from tactile_kit.errors import nearest

NAMES = ("slurm",)


def scheduler(name: str) -> Scheduler:
    """The scheduler of that name. Raises ``ReproduceError`` for an unknown one."""
    if name not in NAMES:
        raise ReproduceError(f"scheduler {name!r} unknown{nearest(name, NAMES)}")
    from importlib import import_module

    return import_module(f"reproduce.clusters.{name}").make()
