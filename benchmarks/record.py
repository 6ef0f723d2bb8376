"""What every benchmark shares: the record of machine and versions, clocks, and where results go."""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tactile_kit.runs.directory import hardware, revision

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "results" / "benchmarks"


def arguments(doc: str, add: Callable[[argparse.ArgumentParser], None] | None = None) -> argparse.Namespace:
    """The command line that all benchmarks share: ``--quick`` and ``--out``."""
    parser = argparse.ArgumentParser(description=doc.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="a few repeats only, to see that it runs")
    parser.add_argument("--out", type=Path, help="the JSON file (by default in results/benchmarks)")
    if add is not None:
        add(parser)
    return parser.parse_args()


def write(name: str, results: dict[str, Any], options: argparse.Namespace, packages: tuple[str, ...]) -> None:
    """Write ``results`` with machine, versions, date and revision; a quick run goes nowhere unless told where."""
    record = {"benchmark": name, "machine": machine(packages), **results}
    text = json.dumps(record, indent=1) + "\n"
    path = options.out or (None if options.quick else RESULTS / f"{name}.json")
    if path is None:
        print(text)
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    print(f"wrote {path}")


def machine(packages: tuple[str, ...]) -> dict[str, Any]:
    """Processor, cores, load, versions of ``packages``, date and git revision."""
    versions = {"python": platform.python_version()}
    for package in packages:
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            versions[package] = "absent"
    return {
        **hardware(),
        # of other work and of this benchmark itself
        "load": round(os.getloadavg()[0], 2),
        "versions": versions,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "revision": revision(),
    }


def from_tests(path: str) -> Any:
    """A helper module of the tests, by its path below ``tests/``; it may import those beside it."""
    file = ROOT / "tests" / path
    if str(file.parent) not in sys.path:
        sys.path.append(str(file.parent))
    return importlib.import_module(file.stem)


class Sections:
    """Seconds by section; the time of an inner section does not count for the outer one.

    Args:
        clock: by default the CPU time of this thread.
    """

    def __init__(self, clock: Callable[[], float] = time.thread_time) -> None:
        self.clock = clock
        self.seconds: dict[str, float] = {}
        self.calls: dict[str, int] = {}
        self._inner = [0.0]

    def wrap(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """``function``, its time counted as ``name``."""
        clock, inner, seconds, calls = self.clock, self._inner, self.seconds, self.calls
        seconds[name], calls[name] = 0.0, 0

        def timed(*args: Any, **kwargs: Any) -> Any:
            inner.append(0.0)
            start = clock()
            try:
                return function(*args, **kwargs)
            finally:
                taken = clock() - start
                seconds[name] += taken - inner.pop()
                calls[name] += 1
                inner[-1] += taken

        return timed

    @contextmanager
    def patched(self, places: dict[str, tuple[Any, str]]) -> Iterator[None]:
        """Time ``{name: (owner, attribute)}`` while the context lasts."""
        kept = [(owner, attribute, getattr(owner, attribute)) for owner, attribute in places.values()]
        try:
            for name, (owner, attribute) in places.items():
                setattr(owner, attribute, self.wrap(name, getattr(owner, attribute)))
            yield
        finally:
            for owner, attribute, function in kept:
                setattr(owner, attribute, function)

    def clear(self) -> None:
        """Start from zero."""
        for name in self.seconds:
            self.seconds[name], self.calls[name] = 0.0, 0
