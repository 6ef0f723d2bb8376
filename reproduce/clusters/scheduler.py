"""What a scheduler has to be able to do."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Protocol

from reproduce.errors import ReproduceError


class SchedulerError(ReproduceError):
    """A scheduler that refuses, with what it said."""


class Unreachable(ReproduceError):
    """A scheduler that does not answer at the moment: nothing is known of its jobs, and nothing happened to them."""


@dataclass(frozen=True)
class Request:
    """A job to be run: what, and what it needs."""

    name: str  # stage/item
    token: str  # unlike any other request's
    script: str  # for sh
    output: str  # file for what the script itself says
    threads: int
    mem_mb: int
    minutes: int
    resources: dict[str, object]  # what else the profile says


@dataclass(frozen=True)
class Standing:
    """How a job stands with its scheduler."""

    alive: bool
    waiting: bool = False
    where: str = ""  # the node
    word: str = ""  # the scheduler's own, such as TIMEOUT


class Scheduler(Protocol):
    """Hands out jobs. All ids are the scheduler's own."""

    name: str
    turn: str  # shell text for this start of a job: its id and how often it was started before
    again: str  # shell text, for a job itself: to be started again, as the same job; empty: it can't

    def submit(self, request: Request) -> str:
        """Hands in a job; returns its id. Raises ``Unreachable`` or ``SchedulerError``."""
        ...

    def find(self, token: str) -> str | None:
        """The id of the job that was handed in with ``token``, None if there is none. Raises ``Unreachable``."""
        ...

    def standings(self, jobs: Collection[str]) -> dict[str, Standing]:
        """How jobs stand; those it no longer knows are left out. Raises ``Unreachable``."""
        ...

    def stop(self, jobs: Collection[str], hard: bool = False) -> None:
        """Asks jobs to end: SIGTERM alone, or (``hard``) followed by SIGKILL. Raises ``Unreachable``."""
        ...
