"""Drives Snakemake: what is to be done, the doing, progress, and the ends a run can come to."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from reproduce import heartbeat, owner
from reproduce.clusters.watch import RUN, Watch
from reproduce.errors import ReproduceError
from reproduce.files import CODE, shown
from reproduce.plan import Plan
from reproduce.prepare import describe, prepare
from reproduce.profiles import Profile, load_profile
from reproduce.progress import Progress
from tactile_kit.progress import duration

_STAGE = re.compile(r"-m reproduce stage (\S+)(?: (\S+))? --pipeline")
_SECONDS = {"objects": 2.0, "grasps": 60.0, "film": 40.0}  # rough cost of jobs, for the time left only
_EPISODE, _STEP, _ARTEFACT = 0.15, 0.0003, 3.0


def run(plan: Plan, jobs: int, profile: str | None = None, quiet: bool = False) -> int:
    """Makes everything of ``plan`` that isn't up to date; returns an exit status.

    Args:
        jobs: how many jobs at a time (cores here, jobs in the cluster's queue with a profile).
        profile: a Snakemake profile, by name or folder: the same jobs on a cluster.

    Raises ``ReproduceError`` for a profile that isn't there, ``BusyError`` where another run is at work.
    """
    cluster = load_profile(profile) if profile is not None else None
    print(describe(plan), flush=True)
    began = time.monotonic()
    with owner.hold(plan.pipeline) as lock:
        config = prepare(plan)
        command = _command(plan, config, jobs, cluster)
        wanted = _wanted(command, config)
        if not wanted:
            print(f"nothing to do: everything in {shown(plan.out)} is up to date", flush=True)
            return 0
        print(
            f"{len(wanted)} jobs to do, {jobs} at a time; logs in {shown(plan.pipeline / 'logs')}", flush=True
        )
        log = plan.pipeline / "snakemake.log"
        watch = None
        if cluster is not None:
            (plan.pipeline / "cluster" / "states").mkdir(parents=True, exist_ok=True)
            watch = Watch(plan.pipeline, cluster.seconds, _this_run())
        retries = cluster.retries if cluster is not None else 0
        with (
            log.open("w", encoding="utf-8") as output,
            Progress(plan.pipeline, wanted, watch, tries=1 + retries) as progress,
        ):
            status = _execute(command, lock, output, progress, watch)
    if status != 0:
        _tell_failure(plan, wanted, log)
        return status
    print(
        f"done in {duration(time.monotonic() - began)}; open {shown(plan.outputs('report')[0])}", flush=True
    )
    return 0


def _command(plan: Plan, config: Path, jobs: int, profile: Profile | None) -> list[str]:
    command = [
        sys.executable, "-m", "snakemake",
        "--snakefile", str(CODE / "reproduce" / "Snakefile"),
        "--directory", str(plan.pipeline),
        "--configfile", str(config),
        "--rerun-incomplete",  # what a killed job was writing is made again
        "--keep-going",
        "--nolock",  # the folder is held by our own lock, which dies with its holder
        "--printshellcmds",
        "--latency-wait", "60" if profile else "2",
        "--jobs" if profile else "--cores", str(jobs),
    ]  # fmt: skip
    return [*command, "--profile", str(profile.folder)] if profile else command


def _this_run() -> str:
    return owner.owner_environment()[owner.OWNER]


def _environment(local: bool) -> dict[str, str]:
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(filter(None, [str(CODE), os.environ.get("PYTHONPATH")]))
    }
    # One thread a process: jobs run side by side, and results must not depend on the number of cores.
    environment |= {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1", "NO_COLOR": "1"}
    environment |= {RUN: _this_run(), "REPRODUCE_PYTHON": sys.executable}  # for profiles
    return environment | (owner.owner_environment() if local else {})


def _wanted(command: list[str], config: Path) -> dict[str, float]:
    """The jobs Snakemake would run, with a rough cost each. Our own commands are what it prints."""
    dry = subprocess.run(
        [*command, "--dry-run"], capture_output=True, text=True, env=_environment(False), check=False
    )
    if dry.returncode != 0:
        raise ReproduceError(f"the workflow can't be planned: {(dry.stderr or dry.stdout).strip()[-2000:]}")
    content = json.loads(config.read_text(encoding="utf-8"))
    jobs = {}
    for stage, item in _STAGE.findall(dry.stdout + dry.stderr):
        jobs[f"{stage}/{item}" if item else stage] = _cost(stage, item, content)
    return jobs


def _cost(stage: str, item: str, content: dict) -> float:
    if stage == "evaluate":
        return 5.0 + _EPISODE * content["evaluate"][item]["episodes"]
    if stage == "train":
        return 10.0 + _STEP * content["train"][item]["steps"]
    return _SECONDS.get(stage, _ARTEFACT)


def _execute(command: list[str], lock: int, output, progress: Progress, watch: Watch | None) -> int:
    process = subprocess.Popen(
        command, stdout=output, stderr=subprocess.STDOUT, env=_environment(watch is None), start_new_session=True,
        pass_fds=(lock,), preexec_fn=_die_with_parent,
    )  # fmt: skip
    try:
        with _signals_raised():
            while process.poll() is None:
                if watch is not None:
                    watch.update()
                progress.update()
                time.sleep(0.5)
    except _Stop as stop:
        with _signals_raised():
            _end(process, watch, progress)
        raise SystemExit(128 + stop.number) from None
    return process.returncode


class _Stop(BaseException):
    """An interrupt or a termination."""

    def __init__(self, number: int) -> None:
        self.number = number


@contextlib.contextmanager
def _signals_raised() -> Iterator[None]:
    def stop(number: int, _: object) -> None:
        raise _Stop(number)

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _end(process: subprocess.Popen, watch: Watch | None, progress: Progress) -> None:
    """Ends all jobs, here and on a cluster; finished ones are kept. A second signal cuts it short."""
    progress.stopping = True
    try:
        if watch is not None:
            progress.say("ends the jobs; once more, and they go on without this")
        foreign = watch is not None and not watch.jobs_known  # another executor ends its jobs on an interrupt
        for sign in (signal.SIGINT, signal.SIGTERM) if foreign else (signal.SIGTERM,):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, sign)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(30 if sign == signal.SIGINT else 5 if watch is None else 1)
                break
        if watch is not None:
            _kill(process)  # or it would hand in again what ends now
            watch.stop()
    except _Stop:
        progress.say("left alone: what the cluster runs goes on")
    finally:
        _kill(process)  # stages that would not listen
    progress.say("stopped; run the same command again to go on from here")


def _kill(process: subprocess.Popen) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def _die_with_parent() -> None:
    """Linux: the child is killed when this process is, however that happens. Elsewhere stages end by themselves."""
    with contextlib.suppress(OSError, AttributeError):
        import ctypes

        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG


def _tell_failure(plan: Plan, jobs: dict[str, float], log: Path) -> None:
    failed = [job for job in jobs if (heartbeat.read(plan.pipeline, job) or {}).get("state") == "failed"]
    for job in failed:
        file = plan.pipeline / "logs" / f"{job}.log"
        tail = file.read_text(encoding="utf-8", errors="replace").splitlines()[-15:] if file.is_file() else []
        print(f"\n{job} failed; the end of {shown(file)}:", *tail, sep="\n  ", file=sys.stderr)
    if not failed:
        tail = log.read_text(encoding="utf-8", errors="replace").splitlines()[-20:]
        print(f"\nthe workflow failed; the end of {shown(log)}:", *tail, sep="\n  ", file=sys.stderr)
    print(
        "\nmend the cause and run the same command again: what is finished is kept",
        file=sys.stderr,
        flush=True,
    )
