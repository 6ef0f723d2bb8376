"""What runs on the node: ``python -m reproduce.clusters.job HOME TURN STAGE [ITEM] --pipeline DIR``.

It runs the stage, and leaves behind how that ended, since a scheduler forgets. When a node is lost, its jobs are started
elsewhere while they may live on there: the newest start of a job writes its turn into a file, and an older one that sees
it ends as by SIGTERM.
"""

from __future__ import annotations

import json
import os
import platform
import signal
import sys
import threading
import time
from pathlib import Path

from reproduce.files import write_atomic

LOOK_EVERY = 1.0  # s
TO_END = 120.0  # s an older start has for its checkpoint


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


def main(home: Path, turn: str, arguments: list[str]) -> int:
    ours = Turn(home, turn)
    print(f"--- job {turn} on {platform.node()}, {time.strftime('%Y-%m-%d %H:%M:%S %z')}", flush=True)
    threading.Thread(target=ours.watch, daemon=True, name="turn").start()
    status = 1
    try:
        from reproduce.cli import main as reproduce

        status = reproduce(["stage", *arguments])
    finally:
        if ours.ours:
            write_atomic(home / "exit.json", json.dumps({"turn": turn, "status": status}))
    return status


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2], sys.argv[3:]))
