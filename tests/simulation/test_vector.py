"""Worker processes: the same results from any number of them, and clear ends when one fails."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import randomization
from tactile_kit.simulation.config import SimulationConfig
from tactile_kit.simulation.vector import Blueprint, VectorSimulation, WorkerError


@pytest.fixture
def build(bodies, bank):
    made = []

    def make(environments: int, workers: int, horizon: int = 4, config=None) -> VectorSimulation:
        preset = randomization.preset("default")
        blueprint = Blueprint(config or SimulationConfig(), bodies, bank, preset, horizon)
        made.append(VectorSimulation(blueprint, environments, workers))
        views = made[-1].views
        views["next_variant"][:] = np.arange(environments) % 2
        views["next_seed"][:] = np.arange(environments)
        views["next_gravity"][:] = 9.81
        return made[-1]

    yield make
    for one in made:
        one.close()


def children() -> set[int | None]:
    return {process.pid for process in multiprocessing.active_children()}


@pytest.mark.parametrize("workers", [-1, 4])
def test_there_are_not_more_workers_than_environments(build, workers: int) -> None:
    with pytest.raises(ValueError, match="0 to the 3 environments"):
        build(3, workers)
    with pytest.raises(ValueError, match="num_envs"):
        build(0, 0)


def test_a_worker_told_to_end_serves_as_long_as_it_is_asked(build) -> None:
    """Schedulers tell every process of a job; the parent saves its state first."""
    simulation = build(2, 1, horizon=50)
    simulation.reset()
    (process,) = simulation._processes
    os.kill(process.pid, signal.SIGTERM)
    for _ in range(3):
        simulation.step_async()
        simulation.step_wait()
    process.join(15.0)
    assert process.exitcode == 0
    with pytest.raises(WorkerError, match="died"):
        simulation.step_async()
        simulation.step_wait()


def test_an_exception_in_a_worker_reaches_the_caller_with_its_traceback(build) -> None:
    before = children()
    simulation = build(2, 2)
    simulation.views["next_variant"][1] = 99
    with pytest.raises(WorkerError, match=r"(?s)worker 1 failed.*Traceback.*in reset.*IndexError"):
        simulation.reset()
    assert children() == before
    with pytest.raises(WorkerError, match="closed"):
        simulation.step_async()
    with pytest.raises(WorkerError, match="closed"):
        simulation.reset()


def test_an_exception_while_workers_start_leaves_none_behind(bodies, bank) -> None:
    before = children()
    broken = Blueprint("no settings", bodies, bank, randomization.preset("none"), 4)
    with pytest.raises(WorkerError, match=r"(?s)Traceback.*AttributeError"):
        VectorSimulation(broken, 2, 2)
    assert children() == before


def test_a_dead_worker_is_an_error_and_the_others_end(build) -> None:
    before = children()
    simulation = build(2, 2)
    simulation.reset()
    assert len(children() - before) == 2
    simulation._processes[0].kill()
    simulation._processes[0].join()
    with pytest.raises(WorkerError, match="worker 0 died with exit code -9"):
        simulation.step_async()
        simulation.step_wait()
    assert children() == before


def test_a_worker_that_died_is_noticed_by_reset_too(build) -> None:
    simulation = build(1, 1)
    simulation._processes[0].kill()
    simulation._processes[0].join()
    with pytest.raises(WorkerError, match="worker 0 died with exit code -9"):
        simulation.reset()


def test_a_worker_that_hangs_is_an_error_that_says_where(build, monkeypatch: pytest.MonkeyPatch) -> None:
    before = children()
    simulation = build(4, 1, config=SimulationConfig(steps_per_second=6000, solver_iterations=500))
    simulation.reset()
    monkeypatch.setattr("tactile_kit.simulation.vector.TIMEOUT", 0.5)  # less than such a step takes
    simulation.step_async()
    with pytest.raises(WorkerError, match=r"(?s)worker 0 did not answer .*; it hangs at:.*File .*worker\.py"):
        simulation.step_wait()
    assert children() == before
    with pytest.raises(WorkerError, match="closed"):
        simulation.step_async()


def test_a_worker_that_was_stopped_is_an_error(build, monkeypatch: pytest.MonkeyPatch) -> None:
    before = children()
    simulation = build(1, 1)
    simulation.reset()
    monkeypatch.setattr("tactile_kit.simulation.vector.TIMEOUT", 0.5)
    os.kill(simulation._processes[0].pid, signal.SIGSTOP)
    simulation.step_async()
    with pytest.raises(WorkerError, match=r"worker 0 did not answer .* does not even tell"):
        simulation.step_wait()
    assert children() == before


def test_close_ends_the_workers_and_may_come_twice(build) -> None:
    before = children()
    simulation = build(2, 2)
    simulation.reset()
    folder = simulation._stacks
    assert len(list(folder.iterdir())) == 2
    simulation.close()
    simulation.close()
    assert children() == before and not folder.exists()


ORPHANS = """
import os, signal, sys
import numpy as np
import object_sets, randomization
from tactile_kit.simulation.bodies import Body
from tactile_kit.simulation.config import SimulationConfig
from tactile_kit.simulation.banks import BulletFinder, find_banks
from tactile_kit.simulation.vector import Blueprint, VectorSimulation
thing = object_sets.load("all")["cube"]
bank = find_banks(BulletFinder(2, SimulationConfig()), [[thing]])[1]
blueprint = Blueprint(SimulationConfig(), [Body(thing)], bank, randomization.preset("none"), 4)
simulation = VectorSimulation(blueprint, 1, 1)
print(simulation._processes[0].pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_workers_end_with_a_parent_that_is_killed(bank) -> None:
    run = subprocess.run(
        [sys.executable, "-c", ORPHANS], capture_output=True, text=True, timeout=120, check=False
    )
    assert run.returncode == -signal.SIGKILL
    worker, deadline = int(run.stdout.split()[-1]), time.monotonic() + 20
    while time.monotonic() < deadline:
        try:
            os.kill(worker, 0)
        except ProcessLookupError:
            return
        with open(f"/proc/{worker}/stat", encoding="utf-8") as file:
            if file.read().rsplit(")", 1)[1].split()[0] == "Z":
                return  # ended; nobody collects it here
        time.sleep(0.2)
    pytest.fail(f"worker {worker} is still running")


def test_workers_never_import_torch(build) -> None:
    simulation = build(1, 1)
    with open(f"/proc/{simulation._processes[0].pid}/maps", encoding="utf-8") as file:
        assert "libtorch" not in file.read()
