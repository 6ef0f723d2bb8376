"""Steps a second of the tactile recipe: policy and estimator learning beside each other, and where the time goes.

    python benchmarks/bench_coupled.py [--turns 12] [--quick]

Preset ``tactile-compiled`` with the estimator and the policy of a tactile agent that is there, so that episodes last as
they do in training. One core and two take turns in one process, a roll-out with its updates each.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from bench_recipe import LAYOUTS, Layout, Training
from record import ROOT, arguments, write

from tactile_kit.agents.warm_start import warm_start
from tactile_kit.runs.config import RunConfig

PRESET = "tactile-compiled"
AGENT = ROOT / "results" / "training" / "tactile-fingers-s0"
COMPARED = ("one core", "two cores")


class Coupled(Training):
    """Past the stages in which the policy does not learn."""

    def __init__(self, layout: Layout, environments: int, agent: Path) -> None:
        changes = {
            "num_envs": environments,
            "num_workers": layout.workers,
            "threads": layout.threads,
            "ppo": {"fixed_steps": 0, "critic_steps": 0},
            "ecrl": {"rho_start": 0.0},
        }
        super().__init__(layout, RunConfig.preset(PRESET, changes))
        warm_start(self.learner, agent, self.env.config.encoding)
        self.learner.iterate(self.tracker)  # episodes of the new policy
        coupling = self.env.coupling
        self.places |= {"estimates": (coupling, "update"), "estimator's updates": (coupling.trainer, "train")}
        self.seconds = dict.fromkeys(self.places, 0.0)


def settings(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--turns", type=int, default=12, help="roll-outs of each layout", metavar="N")


def main() -> None:
    options = arguments(__doc__ or "", settings)
    environments, turns = (64, 1) if options.quick else (512, options.turns)
    trainings = {name: Coupled(LAYOUTS[name], environments, AGENT) for name in COMPARED}
    for _ in range(turns):
        for training in trainings.values():
            training.turn()
    for training in trainings.values():
        training.env.close()
    layouts = {name: training.result() for name, training in trainings.items()}
    results = {"preset": PRESET, "environments": environments, "layouts": layouts}
    write("coupled", results, options, ("torch", "stable-baselines3", "numpy", "numba"))


if __name__ == "__main__":
    main()
