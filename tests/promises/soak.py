"""Trains for hours under random kills, full disks and jumps of the clock, and counts what was lost: nothing may be.

``python tests/promises/soak.py HOURS [--seed N]``; the last line on stdout is JSON. The run directory lies on a small
file system of its own (``unshare`` of util-linux). The clock that jumps is the one a training asks (``time.time`` and
what is made of it), for the machine's own is not ours to set. A run that has reached its steps is held against the same
run in peace, byte for byte, and the next one begins. What is trained is the toy task of the tests: its saves follow
each other as closely as they can, so that most of what happens hits one.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

HERE = Path(__file__).parent
for place in (HERE.parents[1], HERE.parent / "runs", HERE.parent / "agents"):
    sys.path.insert(0, str(place))

STEPS = 8192  # of a run
SAVES = (
    128  # steps between them: every roll-out, so that a run that was asked to stop goes on as if it never was
)
SIZE = 3  # MiB of the file system
OFTEN = 3.0  # events in the time that a run takes in peace, on average
JUMP = 30 * 24 * 3600.0  # s by which the clock jumps at most
FILES = ("policy.safetensors", "critic.safetensors")


def train(directory: Path, jump: float) -> None:
    """Train one run, on a clock that is wrong by ``jump`` seconds and jumps by as much every second."""
    from toy_run import settings, toy

    from tactile_kit.runs import train

    real, begun = time.time, time.monotonic()
    shift = lambda: jump * int(time.monotonic() - begun)  # noqa: E731
    time.time = lambda: max(real() + shift(), 0.0)
    gmtime, strftime = time.gmtime, time.strftime
    time.gmtime = lambda seconds=None: gmtime(time.time() if seconds is None else seconds)
    time.strftime = lambda form, when=None: strftime(form, time.gmtime() if when is None else when)
    train(settings(STEPS, **{"checkpoint.steps": SAVES, "log_every": SAVES}), directory, make_env=toy)


def started(directory: Path, jump: float) -> subprocess.Popen[str]:
    command = [sys.executable, __file__, "--train", str(directory), "--jump", str(jump)]
    return subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)


def fill(ballast: Path) -> None:
    """Leave not a byte."""
    with ballast.open("ab", buffering=0) as file:
        size = 65536
        while size:
            try:
                file.write(b"x" * size)
            except OSError:
                size //= 2


def complaints(run: Path) -> list[str]:
    """What is not as it was promised in a run that has just ended, however it did."""
    from tactile_kit.agents import load_agent
    from tactile_kit.runs import checkpoint as checkpoints
    from tactile_kit.runs import read_metrics

    found = []
    try:
        saved, damaged = checkpoints.newest(run / "checkpoints")
        found += damaged
        if saved is not None and saved.step > SAVES:  # with the first one the agent follows
            load_agent(run)
        lines = read_metrics(run) if (run / "metrics.jsonl").exists() else []
        steps = [line["step"] for line in lines]
        if steps != sorted(set(steps)):
            found.append(f"steps of metrics.jsonl: {steps}")
    except Exception as error:
        found.append(f"{type(error).__name__}: {error}")
    return found


def soak(hours: float, seed: int, folder: Path) -> dict:
    """What happened in ``hours``, counted; ``folder`` becomes the small file system."""
    mounted = ctypes.CDLL(None, use_errno=True).mount(
        b"tmpfs", os.fsencode(folder), b"tmpfs", 0, f"size={SIZE}m".encode()
    )
    if mounted != 0:
        raise OSError(ctypes.get_errno(), "no file system of its own could be mounted")
    peace, begun = Path(tempfile.mkdtemp()), time.monotonic()
    started(peace, 0.0).communicate()
    wanted = [(peace / name).read_bytes() for name in FILES]
    shutil.rmtree(peace)
    wait = (time.monotonic() - begun) / OFTEN
    chance, counts, wrong = random.Random(seed), Counter(), []
    end, run, ballast = time.monotonic() + 3600 * hours, folder / "run", folder / "ballast"
    while time.monotonic() < end:
        process = started(run, chance.choice((0.0, 0.0, JUMP, -JUMP)) * chance.random())
        counts["starts"] += 1
        asked = 0
        while process.poll() is None and time.monotonic() < end:
            try:
                process.wait(chance.expovariate(1.0 / wait))
            except subprocess.TimeoutExpired:
                event = chance.choice(("kill", "stop", "full", "full", "room"))
                counts[event] += 1
                if event == "full":
                    fill(ballast)
                elif event == "room":
                    ballast.unlink(missing_ok=True)
                else:
                    asked = signal.SIGKILL if event == "kill" else signal.SIGTERM
                    process.send_signal(asked)
        if process.poll() is None:
            process.kill()
            asked = signal.SIGKILL
        said = process.communicate()[1]
        refused = "could not be saved" in said or "can't be written" in said or "No space left" in said
        counts["ends on a full disk"] += refused and process.returncode > 0
        if process.returncode not in (0, -asked) and not refused:
            wrong.append(f"ended with {process.returncode}: {said[-2000:]}")
        ballast.unlink(missing_ok=True)
        if (run / "checkpoints").exists():
            counts["checks"] += 1
            wrong += complaints(run)
        manifest = run / "agent.json"
        if (
            manifest.exists()
            and json.loads(manifest.read_text())["steps"] >= STEPS
            and process.returncode == 0
        ):
            counts["whole runs"] += 1
            counts["equal to the byte"] += [(run / name).read_bytes() for name in FILES] == wanted
            shutil.rmtree(run)
    return {"hours": hours, "seed": seed, "seconds between events": round(wait, 1), **counts, "wrong": wrong}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("hours", type=float, nargs="?", default=8.0)
    parser.add_argument("--seed", type=int, default=0)
    for name, kind in (("--train", Path), ("--jump", float), ("--inside", Path)):
        parser.add_argument(name, type=kind, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.train is not None:
        train(chosen.train, chosen.jump)
        return 0
    if chosen.inside is not None:
        found = soak(chosen.hours, chosen.seed, chosen.inside)
        print(json.dumps(found))
        return bool(found["wrong"]) or found.get("whole runs", 0) != found.get("equal to the byte", 0)
    with tempfile.TemporaryDirectory() as folder:
        space = ["unshare", "--map-root-user", "--mount", sys.executable, __file__]
        inside = [str(chosen.hours), "--seed", str(chosen.seed), "--inside", folder]
        return subprocess.run([*space, *inside], check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
