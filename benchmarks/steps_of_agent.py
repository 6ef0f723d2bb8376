"""One trained agent at several physics steps, side by side on the same episodes.

    python benchmarks/steps_of_agent.py [--agent results/agents/oracle-vec_bps-geometric8-s0] [--episodes-per-goal 1]

Not part of ``make bench``: with all 24 goals and 8 objects it plays 192 episodes at every step, some minutes of a core.
All start from the same grasps, which were looked for at 1/60 s.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from record import ROOT, arguments, write

import randomization
from tactile_kit.agents.agent import load_agent
from tactile_kit.evaluation import evaluate
from tactile_kit.evaluation.intervals import stratified_bootstrap, wilson

RATES = (60, 120, 240, 480)  # Hz


def rate(successes: int, of: int) -> dict[str, Any]:
    low, high = wilson(successes, of)
    return {"rate": successes / of, "low": low, "high": high, "n": of}


def measure(
    agent: Any, steps_per_second: int, options: SimpleNamespace | argparse.Namespace
) -> dict[str, Any]:
    """Success, final angle and drops at one step."""
    rows = evaluate(
        agent,
        options.objects,
        steps_per_second=steps_per_second,
        episodes_per_goal=options.episodes_per_goal,
        goals_per_case=options.goals,
        randomization=options.randomization,
        num_workers=options.workers,
    )
    theta = np.array([row.theta for row in rows if row.theta is not None])
    low, high = stratified_bootstrap(
        [theta],
        lambda strata: float(strata[0].mean()),
        generator=randomization.stream(0, "benchmark", "bootstrap"),
    )
    return {
        "steps_per_second": steps_per_second,
        "episodes": len(rows),
        "success": rate(sum(row.success for row in rows), len(rows)),
        "drop": rate(sum(row.drop for row in rows), len(rows)),
        "theta": float(theta.mean()),
        "theta_interval": [float(low), float(high)],
        "faults": sum(bool(row.fault) for row in rows),
    }


def main() -> None:
    def add(parser: argparse.ArgumentParser) -> None:
        parser.add_argument(
            "--agent",
            type=Path,
            default=ROOT / "results" / "agents" / "oracle-vec_bps-geometric8-s0",
            help="directory of the agent",
        )
        parser.add_argument("--objects", default="geometric8")
        parser.add_argument("--episodes-per-goal", type=int, default=1)
        parser.add_argument("--goals", type=int, default=24, help="of the 24 goals an object")
        parser.add_argument("--randomization", default="default")
        parser.add_argument("--rates", type=int, nargs="+", default=list(RATES), metavar="HZ")
        parser.add_argument("--workers", type=int, default=1)

    options = arguments(__doc__ or "", add)
    if options.quick:
        options.goals, options.rates = 3, options.rates[:2]
    agent = load_agent(options.agent)
    rows = []
    for steps_per_second in options.rates:
        rows.append(measure(agent, steps_per_second, options))
        print(rows[-1], flush=True)
    settings = {
        name: getattr(options, name) for name in ("objects", "episodes_per_goal", "goals", "randomization")
    }
    results = {"agent": options.agent.resolve().name, "settings": settings, "rows": rows}
    write("steps_of_agent", results, options, ("pybullet", "torch", "numpy"))


if __name__ == "__main__":
    main()
