"""Tables of docs/physics.md."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

# The lab's own simulated cube roll-outs (its website): rms, 95 %, max of the joint speeds, rad/s.
LAB_SPEEDS = (0.53, 1.1, 2.1)
Row = dict[str, Any]


def share(value: dict[str, float]) -> str:
    """A rate with its Wilson interval."""
    return f"{value['rate']:.2f} [{value['low']:.2f}, {value['high']:.2f}]"


def three(value: dict[str, float], digits: int) -> str:
    """Median, 95 % and maximum."""
    if not value:
        return "–"
    return " / ".join(f"{value[name]:.{digits}f}" for name in ("median", "q95", "max"))


QUANTITIES: dict[str, Callable[[Row], str]] = {
    "CPU ms a control step": lambda r: f"{r['cpu_milliseconds']:.2f}",
    "heuristic: tries that hold": lambda r: share(r["tries_that_hold"]),
    "rest: grasps held for 5 s": lambda r: share(r["held_at_rest"]),
    "rest: creep, mm/s": lambda r: three(r["creep_mm_s"], 2),
    "rest: creep, °/s": lambda r: three(r["creep_deg_s"], 2),
    "rest: penetration, mm": lambda r: three(r["penetration_mm"], 2),
    "rest: joint speed rms, rad/s": lambda r: f"{r['rest_joint_speed_rms']:.4f}",
    "rest: object speed rms, mm/s": lambda r: f"{r['rest_object_speed_rms_mm_s']:.2f}",
    "motion: grasps kept for 3 s": lambda r: share(r["held_in_motion"]),
    "motion: penetration, mm": lambda r: three(r["motion_penetration_mm"], 2),
    "motion: joint speed rms / 95 % / max, rad/s": lambda r: (
        f"{r['joint_speed_rms']:.2f} / {r['joint_speed_95']:.2f} / {r['joint_speed_max']:.1f}"
    ),
    "motion: faults": lambda r: str(r["faults"]),
    "tendon: largest gap q3 − q4 at rest / in motion, rad": lambda r: (
        f"{r['rest_tendon_gap_max']:.4f} / {r['motion_tendon_gap_max']:.4f}"
    ),
    "free hand: joint angles off the reference, rms / max, rad": lambda r: (
        f"{r['free_hand_error']['rms']:.3f} / {r['free_hand_error']['max']:.3f}"
    ),
    "energy: swinging fingers after 0.2 s": lambda r: f"{100 * r['energy_of_fingers']:+.3f} %",
    "energy: spinning L after 5 s": lambda r: f"{100 * r['energy_of_object']:+.2f} %",
}


def transposed(rows: list[Row], heads: list[str]) -> list[str]:
    """Quantities downwards, settings across."""
    lines = ["| | " + " | ".join(heads) + " |", "|---|" + "---|" * len(heads)]
    for name, cell in QUANTITIES.items():
        lines.append(f"| {name} | " + " | ".join(cell(row) for row in rows) + " |")
    return lines


def _usual(record: Row) -> int:
    """The iterations that all steps were run with."""
    return next(row["solver_iterations"] for row in record["rows"] if row["steps_per_second"] > 60)


def steps(record: Row) -> list[str]:
    """One column a step size."""
    rows = [row for row in record["rows"] if row["solver_iterations"] == _usual(record)]
    lab = " / ".join(f"{value:g}" for value in LAB_SPEEDS)
    return [
        f"{record['settings']['objects']} objects, {record['settings']['grasps_an_object']} grasps each, "
        f"{_usual(record)} solver iterations. Triples are median / 95 % / maximum; rates come with 95 % Wilson "
        f"intervals. Joint speeds of the lab's simulated cube roll-outs, for scale: {lab} rad/s.",
        "",
        *transposed(rows, [f"1/{row['steps_per_second']} s" for row in rows]),
    ]


def iterations(record: Row) -> list[str]:
    """One column a number of iterations, at the coarsest step."""
    rows = [row for row in record["rows"] if row["steps_per_second"] == 60]
    rows.sort(key=lambda row: row["solver_iterations"])
    return transposed(rows, [f"{row['solver_iterations']} iterations" for row in rows])


def agent(record: Row) -> list[str]:
    """One row a step size."""
    lines = [
        f"`{record['agent']}`, {record['settings']['objects']}, {record['settings']['episodes_per_goal']} episode(s) a "
        f"goal, randomisation `{record['settings']['randomization']}`, the same episodes at every step.",
        "",
        "| step | episodes | success | mean final angle, rad | drops | faults |",
        "|---|---|---|---|---|---|",
    ]
    for row in record["rows"]:
        low, high = row["theta_interval"]
        lines.append(
            f"| 1/{row['steps_per_second']} s | {row['episodes']} | {share(row['success'])} "
            f"| {row['theta']:.2f} [{low:.2f}, {high:.2f}] | {share(row['drop'])} | {row['faults']} |"
        )
    return lines
