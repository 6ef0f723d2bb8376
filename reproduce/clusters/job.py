"""What runs on the node: ``python -m reproduce.clusters.job HOME TURN LEG STAGE [ITEM] --pipeline DIR``.

It runs the stage, and leaves behind how that ended, since a scheduler forgets. When a node is lost, its jobs are
started elsewhere while they may live on there: the newest start of a job writes its turn into a file, and an older one
that sees it ends as by SIGTERM. A training longer than its time limit ends with a checkpoint shortly before, and asks
for LEG more minutes (0: it doesn't) by the command that is AGAIN in the environment.
"""

from __future__ import annotations

import json
import os
import platform
import shlex
import signal
import subprocess
import sys
import threading
import time
import uuid
from pathlib import Path

from reproduce.files import write_atomic

LOOK_EVERY = 1.0  # s
TO_END = 120.0  # s an older start has for its checkpoint
MARGIN = 240.0  # s before the limit in which a signal means that it is near
STOPPED = 128 + signal.SIGINT  # as a training says that it has a checkpoint and is to go on


class Turn:
    """This start of a job, among all that there ever were."""

    def __init__(self, home: Path, turn: str) -> None:
        self.home, self.turn = home, turn
        write_atomic(home / "turn", turn)

    @property
    def ours(self) -> bool:
        try:
            return (self.home / "turn").read_text(encoding="utf-8") == self.turn
        except OSError:
            return True  # a file system that is away tells nothing

    def watch(self) -> None:
        """Ends this process once a later start has taken over."""
        while self.ours:
            time.sleep(LOOK_EVERY)
        print(f"{self.turn}: started again elsewhere; this start ends", flush=True)
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(TO_END)
        os._exit(128 + signal.SIGTERM)


def main(home: Path, turn: str, leg: int, arguments: list[str]) -> int:
    # unlike any other start's: a controller that was restarted may have forgotten that it counted
    turn = f"{turn}.{uuid.uuid4().hex[:8]}"
    ours, began = Turn(home, turn), time.monotonic()
    print(f"--- job {turn} on {platform.node()}, {time.strftime('%Y-%m-%d %H:%M:%S %z')}", flush=True)
    threading.Thread(target=ours.watch, daemon=True, name="turn").start()
    status = 1
    try:
        from reproduce.cli import main as reproduce

        status = reproduce(["stage", *arguments])
    finally:
        used = time.monotonic() - began
        if leg and status == STOPPED and used > 60 * leg - MARGIN and ours.ours:
            print(f"{turn}: its {leg} minutes are over; goes on in the next leg", flush=True)
            subprocess.run(shlex.split(os.path.expandvars(os.environ["AGAIN"])), check=False)
            time.sleep(MARGIN)  # until it is ended
        if ours.ours:
            write_atomic(home / "exit.json", json.dumps({"turn": turn, "status": status}))
    return status


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), sys.argv[4:]))
