"""What holds for every test: property tests without deadlines, and one cache for the whole run, empty at its start."""

from __future__ import annotations

import os
import shutil
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


BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
# Without a GPU: WebGL by software.
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


@pytest.fixture(scope="session")
def browser():
    """A headless Chromium of the machine, driven by playwright."""
    sync = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip(f"no browser among {', '.join(BROWSERS)}; Debian has it as package chromium")
    with sync.sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=found, args=FLAGS)
        yield started
        started.close()
