"""Tables of docs/compiled.md."""

from __future__ import annotations

from typing import Any

from tables_physics import share

Row = dict[str, Any]


def _off(apart: Row) -> str:
    return f"{apart['apart_mm']:.1f} mm, {apart['apart']:.2f} rad"


def speed(record: Row) -> list[str]:
    """Cost of a control step."""
    cost = record["cpu_microseconds"]
    return [
        "| | CPU µs a control step | speed |",
        "|---|---|---|",
        *(
            f"| {head} | {cost[name]:.0f} | {cost['bullet'] / cost[name]:.1f} |"
            for name, head in (
                ("bullet_240", "Bullet, 1/240 s"),
                ("bullet", "Bullet, 1/60 s"),
                ("compiled", "compiled, 1/60 s"),
            )
        ),
    ]


def lanes(record: Row) -> list[str]:
    """Cost of a control step under the oracle, by kernel and by part."""
    kernels = record["kernels"]
    rows = []
    if kernels["scalar"] is not None:
        rows.append(("kernel before lanes", kernels["environments"], kernels["scalar"], 1.0))
    rows.append(("kernel", kernels["environments"], kernels["lanes"], kernels["ratio"]))
    lines = [
        "| | environments | CPU µs a control step | speed |",
        "|---|---|---|---|",
        *(
            f"| {name} | {count} | {cost:.1f} | {'' if ratio is None else f'{ratio:.1f}'} |"
            for name, count, cost, ratio in rows
        ),
    ]
    for whole in record["whole"]:
        parts = whole["parts"]
        around = parts["begin"] + parts["end"]
        lines.append(
            f"| whole step: kernel {parts['kernel']:.1f}, around it {around:.1f}, new episodes "
            f"{parts['episodes']:.1f} | {whole['environments']} | {whole['whole']:.1f} | |"
        )
    return lines


def motion(record: Row) -> list[str]:
    """How far engines come apart with time."""
    lines = [
        "| after | the object moved | compiled off Bullet | Bullet at 1/240 s off it | same ends: compiled | 1/240 s |",
        "|---|---|---|---|---|---|",
    ]
    for ours, finer in zip(record["apart"]["compiled"], record["apart"]["bullet_240"], strict=True):
        lines.append(
            f"| {ours['seconds']:.1f} s | {ours['moved_mm']:.1f} mm, {ours['turned']:.2f} rad | {_off(ours)} "
            f"| {_off(finer)} | {100 * ours['agree']:.0f} % | {100 * finer['agree']:.0f} % |"
        )
    return lines


def ends(record: Row) -> list[str]:
    """Episodes that ended in a drop or a fault, by object."""
    lines = [
        "| object | compiled | Bullet, 1/60 s | Bullet, 1/240 s | off Bullet after 1 s |",
        "|---|---|---|---|---|",
    ]
    for row in [
        {"object": "all", **record["ended"], "apart": record["apart"]["compiled"][1]},
        *record["objects"],
    ]:
        lines.append(
            f"| {row['object']} | {share(row['compiled'])} | {share(row['bullet'])} | {share(row['bullet_240'])} "
            f"| {_off(row['apart'])} |"
        )
    return lines
