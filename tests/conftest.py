"""What holds for every test: property tests without deadlines, and one cache for the whole run, empty at its start."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator

import pytest
from hypothesis import settings

settings.register_profile(
    "no_deadline", deadline=None
)  # the clock of a shared machine says nothing about the code
settings.load_profile("no_deadline")

# What a shell starts in the background ignores SIGINT, and so would every process that the tests interrupt.
if (
    threading.current_thread() is threading.main_thread()
    and signal.getsignal(signal.SIGINT) is signal.SIG_IGN
):
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Grasps, bodies and convex parts are prepared once a run, never read from what a user has.

    xdist's workers share it: files in it are named by content and written atomically. A test that puts something
    untrue there, or counts what is searched for, has to set a cache of its own.
    """
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TACTILE_KIT_CACHE", str(folder / "own_cache"))
        yield
