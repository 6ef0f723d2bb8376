"""Slurm, through its own commands. Accounting (``slurmdbd``) is not needed and not asked."""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import subprocess
from collections.abc import Collection

from reproduce.clusters.scheduler import Request, SchedulerError, Standing, Unreachable

WAITING = {
    "PENDING",
    "CONFIGURING",
    "REQUEUED",
    "REQUEUE_HOLD",
    "REQUEUE_FED",
    "SPECIAL_EXIT",
    "RESV_DEL_HOLD",
}
AT_WORK = {"RUNNING", "COMPLETING", "SUSPENDED", "STOPPED", "RESIZING", "SIGNALING", "STAGE_OUT"}
# PREEMPTED is final where the cluster cancels, and soon PENDING where it requeues
_AWAY = re.compile(
    r"unable to contact|connect failure|connection (refused|timed out|reset)|socket timed out|"
    r"communication connection failure|zero bytes were transmitted|unexpected message|temporarily|"
    r"slurm controller|munge|protocol authentication|expired credential",
    re.IGNORECASE,
)
PATIENCE = 60.0  # s for one command
BEFORE_THE_END = 180  # s between SIGTERM and the time limit, for a checkpoint; a fifth of short limits


def make() -> Slurm:
    return Slurm()


class Slurm:
    """The Slurm that ``sbatch`` and ``squeue`` of this machine belong to."""

    name = "slurm"
    turn = "$SLURM_JOB_ID.${SLURM_RESTART_COUNT:-0}"
    again = "scontrol requeue $SLURM_JOB_ID"

    def submit(self, request: Request) -> str:
        # Rule first, since squeue cuts names; the token, so that a job is found whose id was never noted.
        command = [
            "sbatch", "--parsable", f"--job-name={request.name}", f"--comment={request.token}",
            f"--output={request.output}", "--open-mode=append", "--nodes=1", "--ntasks=1",
            f"--cpus-per-task={request.threads}", f"--mem={request.mem_mb}", f"--time={request.minutes}",
            f"--signal=B:TERM@{min(BEFORE_THE_END, 12 * request.minutes)}", "--requeue",
        ]  # fmt: skip
        for option, key in (
            ("account", "slurm_account"),
            ("partition", "slurm_partition"),
            ("qos", "slurm_qos"),
        ):
            if value := request.resources.get(key):
                command.append(f"--{option}={value}")
        command += shlex.split(str(request.resources.get("slurm_extra", "")))
        return self._ask(command, request.script).strip().split(";")[0]

    def find(self, token: str) -> str | None:
        lines = self._ask(["squeue", "--noheader", "--states=all", "--format=%i|%k", *_mine()]).splitlines()
        return next((line.split("|")[0] for line in lines if line.endswith(f"|{token}")), None)

    def standings(self, jobs: Collection[str]) -> dict[str, Standing]:
        said = self._ask(["squeue", "--noheader", "--states=all", "--format=%i|%T|%N", *_mine()])
        found = {}
        for line in said.splitlines():
            job, state, node = line.split("|")
            if job in jobs:
                waiting = state in WAITING
                found[job] = Standing(waiting or state in AT_WORK, waiting, node, state)
        return found

    def stop(self, jobs: Collection[str], hard: bool = False) -> None:
        if not jobs:
            return
        # Gently: only the script's own process, as at the time limit; the stage sees to its workers.
        gently = (["--batch", "--signal=TERM", "--state=RUNNING"], ["--state=PENDING"])
        for options in ([],) if hard else gently:
            with contextlib.suppress(SchedulerError):  # of some that have just ended
                self._ask(["scancel", *options, *jobs])

    def _ask(self, command: list[str], stdin: str | None = None) -> str:
        try:
            done = subprocess.run(
                command, input=stdin, capture_output=True, text=True, check=False, timeout=PATIENCE,
                env=_environment(),
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise Unreachable(f"{command[0]}: no answer in {PATIENCE:.0f} s") from None
        except FileNotFoundError:
            raise SchedulerError(
                f"{command[0]}: no such command here; is this the cluster's login node?"
            ) from None
        if done.returncode:
            said = " ".join(done.stderr.split())
            raise (Unreachable if _AWAY.search(said) else SchedulerError)(said or f"{command[0]} failed")
        return done.stdout


def _mine() -> list[str]:
    return [f"--user={os.getuid()}"]


def _environment() -> dict[str, str]:
    """Without what a surrounding job's own size would set for ours (a shell on a node); SBATCH_* are the user's."""
    return {
        name: value for name, value in os.environ.items()
        if not name.startswith("SLURM_") or name in ("SLURM_CONF", "SLURM_CLUSTERS")
    }  # fmt: skip
