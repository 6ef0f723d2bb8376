"""One run at a time in an output folder, and no stage that outlives the run that started it."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import signal
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from reproduce.errors import BusyError
from reproduce.files import shown

OWNER = "REPRODUCE_OWNER"  # in the environment of stages: process and start time of the run they belong to


def start_time(process: int) -> str | None:
    """When a process was started (clock ticks since boot), None if there is none: a process id alone may be re-used."""
    try:
        with open(f"/proc/{process}/stat", encoding="utf-8", errors="replace") as file:
            return file.read().rsplit(")", 1)[1].split()[19]
    except OSError:
        pass
    try:  # no /proc on this system
        os.kill(process, 0)
    except ProcessLookupError:
        return None
    except PermissionError:
        pass
    return "unknown"


@contextlib.contextmanager
def hold(folder: Path, patience: float = 20.0) -> Iterator[int]:
    """Holds ``folder`` for this process; yields the lock's file descriptor, to be handed to children that work there.

    The kernel frees the lock when the last holder is gone, however it died. So a lock that can be taken has no living
    owner, and nothing ever has to be unlocked by hand. What a killed run left behind ends by itself within seconds;
    that is waited for.

    Raises ``BusyError`` naming the process that holds the folder.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "lock"
    with path.open("a+", encoding="utf-8") as file:
        deadline = time.monotonic() + patience
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                file.seek(0)
                owner = json.loads(file.read() or "{}")
                here = owner.get("host") == socket.gethostname()
                alive = not here or start_time(owner.get("process", -1)) == owner.get("started")
                if alive or time.monotonic() > deadline:
                    raise BusyError(
                        f"{shown(folder)}: held by process {owner.get('process')} on {owner.get('host')}; wait for"
                        " it to end, or choose another --out"
                    ) from None
                time.sleep(0.2)
        file.seek(0)
        file.truncate()
        process = os.getpid()
        json.dump({"process": process, "started": start_time(process), "host": socket.gethostname()}, file)
        file.flush()
        yield file.fileno()


def owner_environment() -> dict[str, str]:
    """What stages need to know of this process to end with it."""
    return {OWNER: f"{os.getpid()}:{start_time(os.getpid())}:{socket.gethostname()}"}


def end_with_owner() -> None:
    """Interrupts this process once the run that started it is gone. Stages called by hand are left alone."""
    process, _, rest = os.environ.get(OWNER, "").partition(":")
    started, _, host = rest.partition(":")
    if not process or host != socket.gethostname():
        return

    def watch() -> None:
        while start_time(int(process)) == started:
            time.sleep(0.5)
        os.kill(os.getpid(), signal.SIGINT)  # lets the stage close its workers
        time.sleep(5)
        os._exit(130)

    threading.Thread(target=watch, daemon=True, name="owner").start()
