"""The tables of docs/cluster.md: jobs at the paper's sizes, Ray beside processes, and what more cores bring."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

from reproduce import resources
from reproduce.files import ROOT
from reproduce.plan import make_plan
from reproduce.prepare import weight
from reproduce.scales import load_scale
from reproduce.settings import run_settings
from tactile_kit.runs.config import RunConfig

Record = dict[str, Any]
CORES = (64, 256, 1024)


def paper_jobs(record: Record) -> list[str]:
    """Jobs of the scale ``paper`` by kind: how many, what each asks for, core hours and wall time without margin."""
    plan = make_plan(load_scale("paper"), "scratch", ROOT / "results" / "paper")
    groups: dict[str, list[tuple[resources.Need, float]]] = defaultdict(list)
    for run in plan.runs:
        settings = run_settings(plan, run)
        hours = resources.step_microseconds(settings) * settings["steps"] / 3.6e9
        groups[f"train, {run.kind}"].append((resources.training(settings), hours))
    for evaluation in plan.evaluations:
        episodes, workers = weight(evaluation), plan.scale.num_workers
        need = resources.evaluation(episodes, plan.scale.num_envs, workers)
        groups["evaluate"].append((need, resources.EPISODE * episodes / workers / 3600))
    lines = [
        "| jobs | | cores | memory | hours each, measured rates | core hours together | time limit asked for |",
        "|" + "---|" * 7,
    ]
    total = 0.0
    for name, jobs in groups.items():
        need, hours = max(jobs, key=lambda job: job[1])
        together = sum(one.threads * spent for one, spent in jobs)
        total += together
        limit = max(one.minutes for one, _ in jobs) / 60
        lines.append(
            f"| {name} | {len(jobs)} | {need.threads} | {need.mem_mb / 1000:.0f} GB | up to {_hours(hours)} "
            f"| {together:,.0f} | {limit:,.0f} h |"
        )
    oracle = max(hours for _, hours in groups["train, oracle"])
    tactile = max(hours for _, hours in groups["train, tactile"])
    longest = max(hours for _, hours in groups["evaluate"])
    lines += [
        "",
        f"Together {total:,.0f} core hours. With all jobs at once, {len(plan.runs)} nodes of 64 cores, it takes "
        f"{max(oracle, tactile) + longest:,.0f} hours, since no agent of this scale waits for another; with eight "
        f"nodes {_packed(groups, 8):,.0f} hours.",
    ]
    return lines


def _packed(groups: dict[str, list[tuple[resources.Need, float]]], nodes: int) -> float:
    """Hours with that many nodes of 64 cores, longest jobs first, evaluations four to a node after them."""
    free = [0.0] * nodes
    for name in ("train, tactile", "train, oracle"):
        for _, hours in sorted(groups[name], key=lambda job: -job[1]):
            first = free.index(min(free))
            free[first] += hours
    return max(max(free), sum(free) / nodes) + sum(hours for _, hours in groups["evaluate"]) / (4 * nodes)


def _hours(hours: float) -> str:
    return f"{hours:.0f}" if hours >= 10 else f"{hours:.1f}"


def ray(record: Record) -> list[str]:
    """Ray actors beside worker processes."""
    found = record["ray"]
    rows = [
        ("ms a step, wall time (median)", "milliseconds"),
        ("ms a step, CPU time of everything that works for it", "cpu_milliseconds"),
    ]
    lines = [
        f"{found['environments']} environments over {found['workers']} workers on one machine, in turns.",
        "",
        "| | processes | Ray actors | ratio |",
        "|---|---|---|---|",
    ]
    for (label, key), ratio in zip(rows, ("wall_ratio", "cpu_ratio"), strict=True):
        lines.append(
            f"| {label} | {found[key]['processes']:.1f} | {found[key]['ray']:.1f} | {found[ratio]:.3f} |"
        )
    sizes = found["bytes"]
    lines += [
        "",
        f"A step sends {sizes['sent']} bytes to each environment and takes {sizes['received']} from it; "
        f"{sizes['begun']} more where an episode begins.",
    ]
    return lines


def ray_scaling(record: Record) -> list[str]:
    """Steps a second of ``ppo-paper`` on 64, 256 and 1,024 cores, and what is the limit."""
    sizes = record["ray"]["bytes"]
    overhead = max(record["ray"]["cpu_ratio"], 1.0)
    lines = [
        "| agent | cores that simulate | threads that learn | µs a step: simulated | parent | learner "
        "| steps a second | hours for its steps | network, MB/s |",
        "|" + "---|" * 9,
    ]
    plan = make_plan(load_scale("paper"), "scratch", ROOT / "results" / "paper")
    limits = []
    for kind in ("oracle", "tactile"):
        run = next(run for run in plan.runs if run.role == f"{kind}-vec_bps-geometric8")
        for cores in CORES:
            settings = RunConfig.build(run_settings(plan, run), {"num_workers": cores}).to_dict()
            parts = resources.step_parts(settings)
            parts = parts._replace(simulated=parts.simulated * overhead)
            rate = 1e6 / sum(parts)
            lines.append(
                f"| {kind} | {cores:,} | {settings['threads']} | {parts.simulated:.1f} | {parts.parent:.1f} "
                f"| {parts.learner:.1f} | {rate:,.0f} | {settings['steps'] / rate / 3600:,.0f} "
                f"| {rate * (sizes['sent'] + sizes['received']) / 1e6:.0f} |"
            )
        alone = overhead * resources.BULLET
        limits.append(f"{alone / (parts.parent + parts.learner):.0f} cores for the {kind}")
    lines += [
        "",
        f"Parent and learner take as long as the simulation at {' and '.join(limits)}; from there on more cores bring "
        "less than half of their worth, and beyond 64 almost nothing: the parent is the limit, not the network.",
    ]
    return lines
