"""Cluster-generic's submit command: ``python -m reproduce.clusters SCHEDULER SCRIPT``, in the pipeline's folder.

Prints the job's id. A job of an earlier run that still lives, or has ended well meanwhile, is taken over instead,
unless its inputs have changed since.
"""

from __future__ import annotations

import json
import os
import shlex
import sys
import time
import uuid
from dataclasses import replace
from pathlib import Path
from typing import Any

from reproduce import heartbeat
from reproduce.clusters import scheduler
from reproduce.clusters.jobs import Job, Jobs, judge, stamps
from reproduce.clusters.scheduler import Request, Scheduler, Unreachable
from reproduce.clusters.watch import RUN
from reproduce.errors import ReproduceError

PATIENCE = 1800.0  # s for a controller that is being restarted
PAUSE = 5.0
RESUMABLE = "train"  # the stage that goes on from its checkpoint


def main(name: str, script: Path, pipeline: Path) -> str:
    properties = _properties(script)
    where, jobs = scheduler(name), Jobs(pipeline)
    wildcards = properties.get("wildcards") or {}
    stage, item = properties["rule"], "/".join(wildcards.values())
    job = f"{stage}/{item}" if item else stage
    before, run = jobs.read(job), os.environ.get(RUN, "")
    inputs = stamps(properties["input"])
    if before is not None and (taken := _take_over(jobs, where, before, inputs, run)):
        return taken
    request = _request(jobs, where, job, [stage, *([item] if item else [])], properties)
    tries = before.tries + 1 if before is not None and before.run == run else 1
    heartbeat.again(pipeline, job)
    record = jobs.write(Job(job, name, request.token, inputs, properties["output"], run, tries, time.time()))
    try:
        id = _patiently(lambda: where.submit(request), where, request.token)
    except ReproduceError as error:
        heartbeat.fail(pipeline, job, f"{name}: {error}")
        raise
    jobs.named(record, id)
    return id


def _properties(script: Path) -> dict[str, Any]:
    for line in script.read_text(encoding="utf-8").splitlines():
        if line.startswith("# properties = "):
            return json.loads(line.removeprefix("# properties = "))
    raise ReproduceError(f"{script}: no properties of a job in it; allowed is Snakemake's own job script")


def _take_over(jobs: Jobs, where: Scheduler, before: Job, inputs: list[str], run: str) -> str | None:
    """The id of the earlier job, where that will do; ended, where it lives but works on what is no longer wanted."""
    if before.id is None:  # killed while it was handed in
        found = _patiently(lambda: where.find(before.token), where)
        if found is None:
            return None
        before = jobs.named(before, found)
    assert before.id is not None
    id = before.id
    alive, well, _ = judge(jobs, before, _patiently(lambda: where.standings([id]), where).get(id))
    if inputs == before.inputs:
        made = [Path(file) for file in before.outputs]
        done = well and all(file.is_file() and file.stat().st_mtime >= before.submitted for file in made)
        if alive or done:
            print(f"{before.name}: goes on as job {id} of {where.name}", file=sys.stderr, flush=True)
            jobs.write(replace(before, run=run, tries=1))
            return id
    if alive:
        print(f"{before.name}: its inputs changed; ends job {id}", file=sys.stderr, flush=True)
        _patiently(lambda: where.stop([id], hard=True), where)
    return None


def _request(jobs: Jobs, where: Scheduler, job: str, stage: list[str], properties: dict[str, Any]) -> Request:
    home, pipeline = jobs.home(job), jobs.folder.parent
    log = pipeline / properties["log"][0]
    log.parent.mkdir(parents=True, exist_ok=True)
    home.mkdir(parents=True, exist_ok=True)
    resources = properties["resources"]
    minutes = int(resources["runtime"])
    leg = 0
    if (
        stage[0] == RESUMABLE
        and where.again
        and minutes > (longest := int(resources.get("longest", minutes)))
    ):
        leg = minutes = longest
    command = shlex.join([sys.executable, "-m", "reproduce.clusters.job", str(home)])
    rest = shlex.join([str(leg), *stage, "--pipeline", str(pipeline)])
    # exec: signals that are for the script reach the stage, and reach it once
    script = f"""#!/bin/sh
cd {shlex.quote(str(pipeline))}
export AGAIN="{where.again}"
exec {command} "{where.turn}" {rest} >> {shlex.quote(str(log))} 2>&1
"""
    return Request(
        job, uuid.uuid4().hex, script, str(home / "output"), int(properties["threads"]),
        int(resources["mem_mb"]), minutes, resources,
    )  # fmt: skip


def _patiently(ask: Any, where: Scheduler, token: str | None = None) -> Any:
    """Asks until the scheduler answers. What was handed in although the answer got lost is not handed in again."""
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            return ask()
        except Unreachable as error:
            if time.monotonic() > deadline:
                raise
            print(f"{where.name} does not answer, tries again: {error}", file=sys.stderr, flush=True)
            time.sleep(PAUSE)
            if token is not None:
                try:
                    if found := where.find(token):
                        return found
                except Unreachable:
                    continue


if __name__ == "__main__":
    try:
        print(main(sys.argv[1], Path(sys.argv[2]), Path.cwd()))
    except ReproduceError as error:
        sys.exit(f"{sys.argv[1]}: {error}")
