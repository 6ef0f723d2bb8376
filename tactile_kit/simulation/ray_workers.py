"""Simulators in Ray actors, on whatever machines Ray has: the extra ``ray``.

Each actor holds the simulators of some environments. Of each environment the start of its episode and the actions since
are kept here: simulators hold no other state, so that a lost actor is replaced by one that plays these again, and every
byte is as if nothing had happened.
"""

from __future__ import annotations

import itertools
import warnings
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactile_kit.errors import EngineError
from tactile_kit.simulation.vector import TIMEOUT, VectorSimulation, WorkerError
from tactile_kit.simulation.worker import FIELDS, Blueprint, Group, views_of

SENT = ("action", "next_variant", "next_seed", "next_gravity")
STEPPED = ("status", "z", "x", "R", "q")
BEGUN = ("z0", "x0", "R0", "q0")  # only where an episode has begun
ATTEMPTS = 5  # replacements for one step, after which something else than a machine must be wrong

Arrays = list[NDArray[Any]]


class Past(NamedTuple):
    """What one environment has been through in its episode: variant, seed and gravity; actions ``(n, 12)``."""

    start: tuple[int, int, float]
    actions: NDArray[np.float32]


class Actor:
    """The simulators of ``count`` environments; the class that Ray makes an actor of."""

    def __init__(self, blueprint: Blueprint, count: int, past: list[Past] | None) -> None:
        self.views = _arrays(count)
        self.group = Group(blueprint, self.views, range(count))
        for simulator, one in zip(self.group.simulators, past or (), strict=False):
            simulator.reset(*one.start)
            for action in one.actions:
                simulator.step(action.astype(np.float64))

    def reset(self, sent: Arrays) -> Arrays:
        self._take(sent)
        self.group.reset()
        return [self.views[name] for name in BEGUN]

    def step(self, sent: Arrays) -> tuple[Arrays, Arrays, dict[int, dict[str, Any]]]:
        """States of all, first states where episodes have begun, what is known of those that ended."""
        self._take(sent)
        ended = self.group.step()
        return (
            [self.views[name] for name in STEPPED],
            [self.views[name][list(ended)] for name in BEGUN],
            ended,
        )

    def _take(self, sent: Arrays) -> None:
        for name, values in zip(SENT, sent, strict=True):
            self.views[name][:] = values


def _arrays(count: int) -> dict[str, NDArray[Any]]:
    return views_of(
        {
            name: bytearray(count * int(np.prod(shape, dtype=int)) * np.dtype(dtype).itemsize)
            for name, (shape, dtype) in FIELDS.items()
        },
        count,
    )


class RaySimulation(VectorSimulation):
    """``environments`` simulators over ``workers`` Ray actors, each on one core of the machines that Ray has.

    Ray is as it is: ``RAY_ADDRESS`` or a Ray started before names its machines. Without either one is started here.

    Raises:
        EngineError: Ray is not installed.
        WorkerError: an actor raised, or was lost time and again.
    """

    def __init__(self, blueprint: Blueprint, environments: int, workers: int) -> None:
        if environments < 1:
            raise ValueError(f"num_envs = {environments}: allowed are 1 and more")
        if not 1 <= workers <= environments:
            raise ValueError(f"num_workers = {workers}: allowed are 1 to the {environments} environments")
        self._ray = ray = _ray()
        self._group, self._pipes, self._processes = None, [], []
        self._began_ray = not ray.is_initialized()
        if self._began_ray:
            ray.init(log_to_driver=False, include_dashboard=False, configure_logging=False)
        self.views = _arrays(environments)
        self.replaced = 0
        self._starts: list[tuple[int, int, float]] = [(0, 0, 0.0)] * environments
        self._actions = np.zeros((environments, blueprint.horizon, *FIELDS["action"][0]), np.float32)
        self._played = np.zeros(environments, int)
        self._kind = ray.remote(num_cpus=1, scheduling_strategy="SPREAD")(Actor)
        self._blueprint = ray.put(blueprint)
        bounds = np.linspace(0, environments, workers + 1).astype(int)
        self._parts = [slice(first, last) for first, last in itertools.pairwise(bounds.tolist())]
        self._actors: list[Any] = [self._new(part, None) for part in self._parts]
        self._under_way: list[Any] = []

    def _new(self, part: slice, past: list[Past] | None) -> Any:
        return self._kind.remote(self._blueprint, part.stop - part.start, past)

    def reset(self) -> None:
        self._require_open()
        for part in self._parts:
            self._begin(range(part.start, part.stop))
        under_way = [
            actor.reset.remote(self._sent(part))
            for actor, part in zip(self._actors, self._parts, strict=True)
        ]
        for worker, call in enumerate(under_way):
            self._receive(BEGUN, self._parts[worker], self._result(worker, call, "reset", None))

    def step_async(self) -> None:
        self._require_open()
        self._under_way = [
            actor.step.remote(self._sent(part)) for actor, part in zip(self._actors, self._parts, strict=True)
        ]

    def _finish(self) -> dict[int, dict[str, Any]]:
        ended: dict[int, dict[str, Any]] = {}
        for worker, (part, call) in enumerate(zip(self._parts, self._under_way, strict=True)):
            rows = range(part.start, part.stop)
            past = [Past(self._starts[i], self._actions[i, : self._played[i]]) for i in rows]
            states, begun, ends = self._result(worker, call, "step", past)
            self._receive(STEPPED, part, states)
            indices = [part.start + index for index in ends]
            self._receive(BEGUN, indices, begun)
            for index in rows:
                self._actions[index, self._played[index]] = self.views["action"][index]
                self._played[index] += 1
            self._begin(indices)
            ended.update({part.start + index: end for index, end in ends.items()})
        return ended

    def _begin(self, indices: Any) -> None:
        """Notes the episodes that begin."""
        views = self.views
        for index in indices:
            self._starts[index] = (
                int(views["next_variant"][index]), int(views["next_seed"][index]), float(views["next_gravity"][index]),
            )  # fmt: skip
            self._played[index] = 0

    def _sent(self, part: slice) -> Arrays:
        return [self.views[name][part].copy() for name in SENT]

    def _receive(self, names: tuple[str, ...], where: Any, values: Arrays) -> None:
        for name, value in zip(names, values, strict=True):
            self.views[name][where] = value

    def _result(self, worker: int, call: Any, method: str, past: list[Past] | None) -> Any:
        """What a call brings; where its actor is lost, of one that has gone through the same."""
        from ray.exceptions import GetTimeoutError, RayActorError, RayTaskError

        for _ in range(ATTEMPTS):
            try:
                return self._ray.get(call, timeout=TIMEOUT)
            except RayTaskError as error:
                self.close()
                raise WorkerError(f"worker {worker} failed:\n{error}") from None
            except (RayActorError, GetTimeoutError) as error:
                reason = str(error).splitlines()[0]
                warnings.warn(f"worker {worker} was lost and is replaced: {reason}", stacklevel=2)
                self.replaced += 1
                self._ray.kill(self._actors[worker])
                actor = self._actors[worker] = self._new(self._parts[worker], past)
                call = getattr(actor, method).remote(self._sent(self._parts[worker]))
        self.close()
        raise WorkerError(f"worker {worker} was lost {ATTEMPTS} times at one step")

    def _require_open(self) -> None:
        if not self._actors:
            raise WorkerError("the simulation is closed: a worker failed before, or close() was called")

    def close(self, patience: float = 2.0) -> None:
        """End all actors, and Ray where it was started here."""
        for actor in self._actors:
            self._ray.kill(actor)
        self._actors = []
        if self._began_ray and self._ray.is_initialized():
            self._ray.shutdown()


def _ray() -> Any:
    try:
        import ray
    except ImportError:
        raise EngineError(
            "the package ray is not installed; pip install 'tactile-kit[ray]' brings it"
        ) from None
    return ray
