"""Training runs that survive being stopped: one directory, resumed from its newest checkpoint."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from object_sets.storage import write_atomic
from randomization import derive
from tactile_kit.errors import CheckpointError, ConfigError, RunError
from tactile_kit.files import json_bytes, read_json, settle
from tactile_kit.runs import checkpoint as checkpoints
from tactile_kit.runs.config import RunConfig, differences
from tactile_kit.runs.directory import hardware, locked, revision, versions
from tactile_kit.runs.disk import Disk
from tactile_kit.runs.fitting import require_values
from tactile_kit.runs.metrics import MetricsFile, Tracker, read_metrics
from tactile_kit.runs.progress import Progress
from tactile_kit.runs.session import Run
from tactile_kit.runs.starting import starting, whole_rollouts

EnvFactory = Callable[[RunConfig], Any]
FIRST = 60.0  # s of training until the first checkpoint, which ``checkpoint.minutes`` may only shorten


def train(
    config: RunConfig,
    directory: str | Path,
    resume: bool = True,
    *,
    make_env: EnvFactory | None = None,
    quiet: bool = False,
) -> Path:
    """Train an agent in ``directory``; a directory that holds a run of the same settings is continued.

    Args:
        config: all settings.
        directory: the run directory, made when missing; it becomes the agent's directory.
        resume: continue from the newest checkpoint. False: refuse a directory that has one.
        make_env: builds the environment from the settings, for tasks of one's own.
        quiet: no progress on stderr.

    Returns:
        The directory. SIGTERM and SIGINT save a checkpoint and return early (``finished`` tells); a second one
            interrupts at once.

    Raises:
        LockedError: another process works on the directory.
        ConfigError: it holds a run of other settings or versions, with a readable difference.
        CheckpointError: all its checkpoints are damaged.
        FloatingPointError: it diverged.
        RunError: at its start or end the disk is full; in between that is told and work goes on.
    """
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    with locked(directory) as killed, _torch_left_alone():
        settle(directory, "agent.json")
        saved, messages = checkpoints.newest(directory / "checkpoints")
        if saved is not None:
            _check_resume(config, saved, directory, resume)
            done = finished(directory) and (saved.step >= config.steps or _levelled(directory))
            if done and not _evaluation_due(config, directory, saved.step):
                return directory
        torch.set_num_threads(1)  # the learner divides batches, not operations
        torch.set_float32_matmul_precision(config.matmul_precision)
        torch.manual_seed(
            derive(config.seed, "learner", "default")
        )  # nothing should draw from it, but then it repeats
        _write_config(directory / "config.yaml", config.to_yaml().encode())
        progress = Progress(whole_rollouts(config), saved.step if saved else 0, directory.name, quiet)
        disk = Disk(progress.say)
        record = partial(_write_record, directory, resumed=saved)
        disk.attempt("run.json", "this start is not in it", record)
        for message in [*messages, *starting(config, directory, saved, killed)]:
            progress.say(message)
        env = make_env(config) if make_env else default_env(config, quiet)
        if hasattr(env, "simulation"):
            env.simulation.faults = directory / "faults"
        try:
            run = Run(config, directory, make_learner(config, env), env, Tracker(config.num_envs))
            if saved is not None:
                run.restore(saved)
            elif config.warm_start:
                from tactile_kit.agents.warm_start import warm_start

                run.warm_start = warm_start(run.learner, config.warm_start, config.encoding)
            del saved
            if config.ppo.teacher:
                from tactile_kit.agents.teacher import Lessons, Teacher

                run.learner.lessons = Lessons(Teacher(config.ppo.teacher, env), config.ppo.taught_steps)
            metrics = MetricsFile(directory, run.learner.num_timesteps, disk)
            try:
                _loop(run, metrics, progress, disk)
            finally:
                metrics.close()
        finally:
            progress.close()
            env.close()
    return directory


@contextmanager
def _torch_left_alone() -> Iterator[None]:
    """Threads and precision are the process's: afterwards, all else rounds as it would have without this training."""
    threads, precision = torch.get_num_threads(), torch.get_float32_matmul_precision()
    try:
        yield
    finally:
        torch.set_num_threads(threads)
        torch.set_float32_matmul_precision(precision)


def finished(directory: str | Path) -> bool:
    """Whether a run has reached the steps of its own config.yaml, or levelled off before."""
    directory = Path(directory)
    if not (directory / "agent.json").exists() or not (directory / "config.yaml").exists():
        return False
    config = RunConfig.from_yaml(directory / "config.yaml")
    return _levelled(directory) or int(read_json(directory / "agent.json")["steps"]) >= config.steps


def _levelled(directory: Path) -> bool:
    return bool(read_json(directory / "agent.json").get("levelled"))


def _evaluation_due(config: RunConfig, directory: Path, step: int) -> bool:
    if not config.evaluation.at_end:
        return False
    return not any(line.get("evaluation") and line["step"] == step for line in read_metrics(directory))


def default_env(config: RunConfig, quiet: bool = False) -> Any:
    """The training environment of the run's kind; a search for grasps is shown unless ``quiet``."""
    from tactile_kit.task.variants import prepare

    task = config.played
    shared: dict[str, Any] = {
        "num_envs": config.num_envs,
        "num_workers": config.num_workers,
        "seed": derive(config.seed, "training"),
        "variants": prepare(task, config.num_workers, quiet=quiet),
        "workers": config.workers,
    }
    if config.kind == "oracle":
        from tactile_kit.task.vec_env import ReorientVecEnv

        return ReorientVecEnv(task, **shared)
    from tactile_kit.ecrl import TactileVecEnv

    return TactileVecEnv(task, estimator=config.estimator, ecrl=config.ecrl, **shared)


def make_learner(config: RunConfig, env: Any) -> Any:
    """The run's learner."""
    from tactile_kit.agents.ppo import PPO

    rest = rest_action(env) if config.start_at_grasp else None
    return PPO(env, config.ppo, seed=config.seed, rest=rest, threads=config.threads)


def rest_action(env: Any) -> tuple[float, ...] | None:
    """The action that commands a firm grasp, if the environment's actions are absolute joint angles."""
    if getattr(env.config, "action", None) != "absolute":
        return None
    from tactile_kit.hand.kinematics import FIRM_GRASP, JOINT_LOWER, JOINT_UPPER

    middle, half = (JOINT_UPPER + JOINT_LOWER) / 2, (JOINT_UPPER - JOINT_LOWER) / 2
    return tuple(float(value) for value in (FIRM_GRASP - middle) / half)


def _loop(run: Run, metrics: MetricsFile, progress: Progress, disk: Disk) -> None:
    config, learner = run.config, run.learner
    before = run.hours
    begin = time.monotonic()
    pause = 0.0  # seconds of evaluation
    progress.begin()
    run.begin_episodes()
    learner._setup_learn(config.steps, run.tracker, reset_num_timesteps=False)
    saved = last_save_step = learner.num_timesteps
    last_save = last_evaluation = time.monotonic()

    def aside(look: Callable[[Run, MetricsFile, Progress], None]) -> None:
        """An evaluation; its seconds are none of training."""
        nonlocal pause
        started = time.monotonic()
        disk.attempt("an evaluation", "it is left out", lambda: look(run, metrics, progress))
        pause += time.monotonic() - started

    line_time, line_step = time.monotonic(), learner.num_timesteps
    with _signals() as stop:
        while not stop.is_set():
            run.steer()
            if run.over:
                break
            begun = learner.num_timesteps
            iteration = time.monotonic()
            learner.iterate(run.tracker)
            run.hours = before + (time.monotonic() - begin - pause) / 3600
            step, now = learner.num_timesteps, time.monotonic()
            if step // config.log_every > run.logged // config.log_every or step >= config.steps:
                rate = (step - line_step) / max(now - line_time, 1e-9)
                run.line = _line(run, rate)
                run.logged = step
                metrics.write(run.line)
                line_time, line_step = now, step
                progress.update(step, run.line)
            else:
                progress.update(step)
            limits = config.checkpoint
            # The first one comes before the roll-out after this would end too late for it.
            first = not checkpoints.listing(run.directory / "checkpoints")
            wait, ahead = (FIRST, now - iteration) if first else (limits.minutes * 60, 0.0)
            due = now + ahead - last_save >= min(wait, limits.minutes * 60)
            due |= 0 < limits.steps <= step - last_save_step
            if due and step < config.steps:
                if disk.attempt("a checkpoint", "the one before stays", run.save):
                    saved = step
                run.begin_episodes()
                last_save, last_save_step = time.monotonic(), step
            minutes = config.evaluation.minutes
            if minutes and now - last_evaluation >= minutes * 60 and step < config.steps:
                aside(_evaluate)
                last_evaluation = time.monotonic()
            every = config.evaluation.steps
            if every and step // every > begun // every:
                aside(_look)
        _save_last(run, saved)
        if run.calm.over:
            progress.say(f"success has levelled off; over at {learner.num_timesteps:,} steps")
        elif stop.is_set():
            progress.say(f"stopped at {learner.num_timesteps:,} steps; run again to continue")
        if run.over and _evaluation_due(config, run.directory, learner.num_timesteps):
            _evaluate(run, metrics, progress)
            run.export()


def _save_last(run: Run, saved: int) -> None:
    """Leave all that was trained since the checkpoint at ``saved`` steps. Raises RunError where the disk refuses."""
    step = run.learner.num_timesteps
    try:
        if step > saved:
            run.save()
        else:
            run.export()  # a kill may have come between the last checkpoint and its export
    except OSError as problem:
        raise RunError(
            f"{run.directory}: at {step:,} steps it could not be saved ({problem}); make room and run again: "
            "it goes on from the newest checkpoint"
        ) from None


def _line(run: Run, rate: float) -> dict[str, Any]:
    line = {"step": run.learner.num_timesteps, "hours": round(run.hours, 5), **run.tracker.metrics()}
    line |= {"steps_per_second": round(rate, 1), "gravity": run.gravity, "level": run.calm.level}
    if hasattr(run.env, "metrics"):
        line |= run.env.metrics()
    return line | run.learner.metrics()


def _evaluate(run: Run, metrics: MetricsFile, progress: Progress) -> None:
    """Held-out evaluation of the agent as it is now."""
    from tactile_kit.agents.agent import load_agent
    from tactile_kit.evaluation import evaluate

    settings = run.config.evaluation
    run.export()
    agent = load_agent(run.directory)
    rows = evaluate(
        agent,
        objects=settings.objects or run.config.objects,
        goals="octahedral",
        episodes_per_goal=settings.episodes_per_goal,
        seed=run.config.seed,
        num_envs=settings.num_envs,
        num_workers=run.config.num_workers,
        quiet=progress.quiet,
    )
    successes = sum(bool(row.success) for row in rows)
    angles = [row.theta for row in rows if row.theta is not None]
    run.evaluation = {
        "step": run.learner.num_timesteps,
        "hours": round(run.hours, 5),
        "evaluation": True,
        "success_rate": successes / len(rows),
        "episodes": len(rows),
        "drops": sum(bool(row.drop) for row in rows) / len(rows),
        "theta": float(np.mean(angles)) if angles else None,
        **_estimates(run, agent),
    }
    metrics.write(run.evaluation)
    progress.say(f"evaluation: success rate {successes / len(rows):.3f} over {len(rows)} episodes")


def _look(run: Run, metrics: MetricsFile, progress: Progress) -> None:
    """A point of the held-out curve, in the compiled physics."""
    from tactile_kit.agents.agent import load_agent
    from tactile_kit.evaluation.compiled import held_out

    config = run.config
    run.export()
    agent, objects = load_agent(run.directory), config.evaluation.objects or config.objects
    found = held_out(agent, objects, config.evaluation.episodes, seed=config.seed, threads=config.num_workers)
    line = {f"held_out/{name}": value for name, value in found._asdict().items()}
    metrics.write({"step": run.learner.num_timesteps, "hours": round(run.hours, 5), **line})


def _estimates(run: Run, agent: Any) -> dict[str, float]:
    """How well a tactile agent's estimator follows in closed loop, by name."""
    if agent.estimator is None:
        return {}
    from tactile_kit.evaluation.estimates import follow

    objects = run.config.evaluation.objects or run.config.objects
    figures = follow(agent, objects, truth=False, episodes=256, seed=run.config.seed).figures()
    return {f"estimates/{name}": value for name, value in figures.items()}


def _check_resume(config: RunConfig, saved: checkpoints.Checkpoint, directory: Path, resume: bool) -> None:
    if not resume:
        raise ConfigError(
            f"{directory}: holds a run at {saved.step:,} steps; resume it or choose another directory"
        )
    try:
        require_values({"hours": 0.0}, saved.values)  # which is told before anything is prepared
    except ValueError as problem:
        raise CheckpointError(f"{saved.path}: does not fit this run: {problem}") from None
    lines = differences(_completed(saved.values["config"]), config.to_dict())
    found = versions()
    lines += [
        f"version of {name}: {old} -> {found.get(name, 'absent')}"
        for name, old in saved.values["versions"].items()
        if found.get(name) != old
    ]
    if lines:
        raise ConfigError(f"{directory}: holds a run of other settings:\n  " + "\n  ".join(lines))


def _completed(settings: Any) -> Any:
    """A checkpoint's settings with the defaults of those that did not exist yet, which do as it was before them."""
    try:
        return RunConfig.build(settings).to_dict()
    except ConfigError:  # a setting that is gone: the difference shows it
        return settings


def _write_config(path: Path, content: bytes) -> None:
    """Nothing where it is there already: a run goes on though its disk is full. Raises RunError."""
    try:
        if not path.exists() or path.read_bytes() != content:
            write_atomic(path, content)
    except OSError as problem:
        raise RunError(
            f"{path}: can't be written ({problem}); no run starts without its settings on disk"
        ) from None


def _write_record(directory: Path, resumed: checkpoints.Checkpoint | None) -> None:
    """run.json: every start of the run, with hardware, versions and code revision."""
    path = directory / "run.json"
    starts = read_json(path)["starts"] if path.exists() else []
    start = {
        "time": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "from_step": resumed.step if resumed else 0,
        "hardware": hardware(),
        "versions": dict(versions()),
        "git": revision(),
    }
    write_atomic(path, json_bytes({"starts": [*starts, start]}))


@contextmanager
def _signals() -> Iterator[threading.Event]:
    """An event that SIGTERM and SIGINT set; a second signal interrupts at once."""
    stop = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stop  # signals reach the main thread only
        return

    def handle(number: int, frame: Any) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    previous = {number: signal.signal(number, handle) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield stop
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
