"""The command ``object-sets``: list, build, sample, check, render, export. Each calls one function of the package."""

from __future__ import annotations

import os
import signal
import sys
from typing import Annotated

import tyro

from object_sets.commands.build import Build
from object_sets.commands.check import Check
from object_sets.commands.export import Export
from object_sets.commands.listing import List
from object_sets.commands.render import Render
from object_sets.commands.sample import Sample

Command = (
    Annotated[List, tyro.conf.subcommand("list")]
    | Annotated[Build, tyro.conf.subcommand("build")]
    | Annotated[Sample, tyro.conf.subcommand("sample")]
    | Annotated[Check, tyro.conf.subcommand("check")]
    | Annotated[Render, tyro.conf.subcommand("render")]
    | Annotated[Export, tyro.conf.subcommand("export")]
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0 fine, 1 something was refused, 2 wrong arguments."""
    try:
        try:
            return _run(arguments)
        finally:
            sys.stdout.flush()
    except BrokenPipeError:  # `object-sets list | head` has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for what is flushed at the very end
        return 128 + signal.SIGPIPE


def _run(arguments: list[str] | None) -> int:
    from object_sets.errors import ObjectSetError

    command = tyro.cli(
        Command, args=arguments, prog="object-sets", description=__doc__, config=(tyro.conf.OmitArgPrefixes,)
    )
    try:
        return command.run()
    except ObjectSetError as error:
        print(f"object-sets: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(
            "object-sets: interrupted; started again, it goes on with the convex parts found so far",
            file=sys.stderr,
        )
        return 130


if __name__ == "__main__":
    sys.exit(main())
