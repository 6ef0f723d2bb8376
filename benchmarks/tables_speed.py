"""Tables of docs/speed.md."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Record = dict[str, Any]
# Goals at batches of 1,024 and more: how many times faster than each peer, by triangles.
GOALS: dict[str, dict[int, float]] = {
    "warp": {12: 6, 60: 6, 300: 3.5, 5000: 5},
    "warp backward": {12: 20, 60: 25, 300: 35, 5000: 150},
    "open3d": {12: 15, 60: 10, 300: 4, 5000: 4},
    "libigl": {12: 6, 60: 7, 300: 5, 5000: 4},
    "trimesh": {12: 100, 60: 100, 300: 100, 5000: 100},
}
NAMES = {
    "ours": "tactile-kit",
    "ours backward": "tactile-kit, backward",
    "torch": "torch, brute force",
    "warp": "NVIDIA Warp on the CPU",
    "warp backward": "NVIDIA Warp, backward",
    "open3d": "Open3D, closest points and occupancy",
    "libigl": "libigl AABB, no inside test",
    "trimesh": "trimesh, closest points and contains",
}


BUSY = "**no verdict: other work kept the cores busy**"


def significant(value: float | None) -> str:
    """Two digits below ten, else whole numbers."""
    if value is None:
        return "missing"
    return f"{value:.2g}" if value < 10 else f"{value:,.0f}"


def verdict(reached: bool) -> str:
    return "reached" if reached else "**not reached**"


def simulation(record: Record) -> list[str]:
    cube, settings = record["cube"], record["settings"]
    share, rate = cube["floor_share"], cube["steps_per_second_and_core"]
    lines = [
        f"Held cube, physics step 1/{settings['steps_per_second']} s, {settings['solver_iterations']} solver "
        f"iterations, randomisation `{settings['randomization']}`, 16 environments in one process.",
        "",
        "| | measured | wanted |",
        "|---|---|---|",
        f"| control step | {cube['milliseconds']:.2f} ms (best block {cube['milliseconds_best']:.2f}) | |",
        f"| control steps a second and core | {rate:,.0f} (best block {cube['steps_per_second_and_core_best']:,.0f}) "
        f"| over 2,000: {verdict(rate > 2000)} |",
        f"| share of the floor's speed | {share:.2f} | 0.80: {verdict(share >= 0.8)} |",
        f"| floor, one `stepSimulation` | {cube['floor_microseconds_a_physics_step']:.0f} µs | |",
        "",
        "| where the time goes | ms | share |",
        "|---|---|---|",
    ]
    total = sum(cube["sections"].values())
    for name, value in cube["sections"].items():
        lines.append(f"| {name} | {value:.3f} | {value / total:.0%} |")
    return lines


def objects(record: Record) -> list[str]:
    lines = ["| object | convex parts | ms a control step | relative to the cube |", "|---|---|---|---|"]
    for name, row in record["objects"].items():
        lines.append(
            f"| {name} | {row['convex_parts']} | {row['milliseconds']:.2f} | {row['relative_to_cube']:.2f} |"
        )
    worst = max(record["objects"].items(), key=lambda item: item[1]["relative_to_cube"])
    ratio = worst[1]["relative_to_cube"]
    return [
        *lines,
        "",
        f"Wanted: within 2 of the cube. Dearest: {worst[0]}, {ratio:.2f}: {verdict(ratio <= 2)}.",
    ]


def vector(record: Record) -> list[str]:
    workers, memory = record["workers"], record["memory"]
    long, resets = record["memory_over_resets"], record["resets"]
    rates = workers["steps_per_second"]
    # Counting loops hinder each other only by what else runs; and nothing real can scale better than they do.
    busy = workers["ceiling"] < 1.5 or workers["share_of_ceiling"] > 1.05
    return [
        "| | measured | wanted |",
        "|---|---|---|",
        f"| control steps a second, one worker and two | {rates['1']:,.0f} and {rates['2']:,.0f} | |",
        f"| two workers over one | {workers['two_over_one']:.2f} | 1.9: "
        f"{BUSY if busy else verdict(workers['two_over_one'] >= 1.9)} |",
        f"| counting loops in two processes over one (the machine's ceiling) | {workers['ceiling']:.2f} | |",
        f"| two workers, share of that ceiling | {workers['share_of_ceiling']:.2f} | 0.95: "
        f"{BUSY if busy else verdict(workers['share_of_ceiling'] >= 0.95)} |",
        f"| memory of a worker with one environment | {memory['first_mb']:.0f} MB | |",
        f"| memory of each further environment | {memory['each_further_mb']:.0f} MB | stated |",
        f"| growth over {long['resets']:,} resets among {long['bodies']} bodies | {long['growth_mb']:.1f} MB "
        f"({long['growth_kb_a_reset']:.1f} kB a reset) | flat: {verdict(long['growth_kb_a_reset'] < 1)} |",
        f"| one reset | {resets['reset_milliseconds']:.2f} ms | |",
        f"| share of resets in episodes of 100 steps | {resets['share_of_full_episodes']:.1%} | under 5 %: "
        f"{verdict(resets['share_of_full_episodes'] < 0.05)} |",
    ]


def peer(record: Record) -> list[str]:
    times, ratios = record["milliseconds"], record.get("peer_over_ours", {})
    versions = ", ".join(f"{name} {version}" for name, version in record.get("versions", {}).items())
    lines = ["| | CPU ms per 0.1 s simulated | the peer costs |", "|---|---|---|"]
    for name, value in times.items():
        if name != "peer":
            ratio = f"{ratios[name]:.1f} times as much" if name in ratios else "missing"
            lines.append(f"| held cube, physics step 1/{name} s | {value:.2f} | {ratio} |")
    if "peer" in times:
        lines.append(f"| `{record['peer']}` ({versions}) | {times['peer']:.2f} | |")
    else:
        lines.append(f"| `{record['peer']}` | missing | |")
    if "60" in ratios:
        lines += ["", f"Wanted: 5 at the training step: {verdict(ratios['60'] >= 5)}."]
    return lines


def _by_size(record: Record) -> tuple[list[int], list[int], dict[tuple[int, int], Record]]:
    cells = {(row["triangles"], row["batch"]): row for row in record["rows"]}
    return sorted({t for t, _ in cells}), sorted({b for _, b in cells}), cells


def bps(record: Record) -> list[str]:
    triangles, batches, cells = _by_size(record)
    heads = " | ".join(f"{count:,} triangles" for count in triangles)
    lines = [
        f"Microseconds per encode of 64 points, batches of {' / '.join(f'{batch:,}' for batch in batches)}.",
        "",
        f"| | {heads} |",
        "|---|" + "---|" * len(triangles),
    ]
    for key, name in NAMES.items():
        row = [
            " / ".join(significant(cells[count, batch].get(key)) for batch in batches) for count in triangles
        ]
        row = ["missing" if set(cell) <= set("missing /") else cell for cell in row]
        lines.append(f"| {name} | " + " | ".join(row) + " |")
    build = (cells[count, batches[-1]]["build_per_mesh"] / 1e3 for count in triangles)
    lines.append("| tables of one mesh, once, ms | " + " | ".join(f"{value:.2g}" for value in build) + " |")
    return lines


def bps_goals(record: Record) -> list[str]:
    triangles, batches, cells = _by_size(record)
    large = [batch for batch in batches if batch >= 1024]
    heads = " | ".join(f"{count:,} triangles" for count in triangles)
    lines = [
        "How many times faster, the smaller figure of the batches of "
        + " and ".join(f"{batch:,}" for batch in large)
        + "; the wanted factor in brackets.",
        "",
        f"| against | {heads} |",
        "|---|" + "---|" * len(triangles),
    ]
    missed = []
    for key, goals in GOALS.items():
        ours = "ours backward" if key.endswith("backward") else "ours"
        row = []
        for count in triangles:
            found = [cells[count, batch].get(key) for batch in large]
            if any(value is None for value in found) or count not in goals:
                row.append("missing")
                continue
            factor = min(value / cells[count, batch][ours] for value, batch in zip(found, large))
            row.append(f"{significant(factor)} ({goals[count]:g})")
            if factor < goals[count]:
                missed.append(f"{NAMES[key]} at {count:,} triangles")
        lines.append(f"| {NAMES[key]} | " + " | ".join(row) + " |")
    single = {count: cells[count, 1]["ours"] for count in triangles if (count, 1) in cells and count <= 60}
    slow = {count: value for count, value in single.items() if value > 20}
    text = ", ".join(f"{value:.0f} µs at {count}" for count, value in single.items())
    lines += [
        "",
        f"Not reached: {', '.join(missed)}." if missed else "All factors that were measured are reached.",
    ]
    lines += [f"A single encode: {text} triangles (wanted: under 20 µs): {verdict(not slow)}."]
    return lines


def bps_exactness(record: Record) -> list[str]:
    exact = record["exactness"]
    lines = [
        f"{exact['queries']:,} queries, {exact['inside']:,} of them inside, float32, against the float64 twin.",
        "",
        "| | largest error of a distance | sign errors | deepest of them |",
        "|---|---|---|---|",
    ]
    for key, name in NAMES.items():
        if key in exact:
            row = exact[key]
            signs, deepest = row["sign_errors"], row["deepest_sign_error_m"]
            lines.append(
                f"| {name} | {row['largest_distance_error_m']:.1e} m | {'–' if signs is None else signs} "
                f"| {f'{deepest * 1e3:.2g} mm' if signs else '–'} |"
            )
    return lines


def grasps(record: Record) -> list[str]:
    banks, workers = record["banks"], record["workers"]
    ours, bullet = banks["compiled"], banks["bullet"]

    def row(name: str, value: Callable[[Record], str], wanted: str = "") -> str:
        return f"| {name} | {value(bullet)} | {value(ours)} | {wanted} |"

    def share(key: str) -> Callable[[Record], str]:
        def cell(bank: Record) -> str:
            of = bank[key]
            return f"{of['rate']:.3f} [{of['low']:.3f}, {of['high']:.3f}]"

        return cell

    return [
        f"{ours['objects']} objects and sizes, {ours['grasps']:,} grasps, {workers} processes, an empty cache. "
        f"Shares come with 95 % Wilson intervals: {ours['held']['n']} grasps, {ours['success']['n']} episodes of "
        "the same sizes, goals and seeds.",
        "",
        "| | found in Bullet | found in the compiled physics | wanted |",
        "|---|---|---|---|",
        row(
            "until the bank is there, s",
            lambda bank: f"{bank['seconds']:.0f}",
            f"120 for training: {verdict(ours['seconds'] <= 120)}",
        ),
        row(
            "CPU of all processes, s",
            lambda bank: f"{bank['cpu_seconds']:.0f}",
            f"{bullet['cpu_seconds'] / ours['cpu_seconds']:.1f} times less",
        ),
        row("held by Bullet for a second", share("held")),
        row("fell in Bullet within a second", share("fell")),
        row("the agent dropped it within a second", share("dropped_in_a_second")),
        row("the agent dropped it", share("dropped")),
        row("the agent succeeded", share("success")),
    ]


def _layout(label: str, run: Record, names: list[str]) -> str:
    """One row: steps a second, CPU time a step, and its parts."""
    parts = " | ".join(f"{run['parts'][part]:.1f}" for part in names)
    rate = f"{run['steps_per_second']:,.0f} ({run['steps_per_second_best']:,.0f})"
    return f"| {label} | {rate} | {run['microseconds']:.1f} | {parts} |"


def coupled(record: Record) -> list[str]:
    runs = record["layouts"]
    names = list(next(iter(runs.values()))["parts"])
    lines = [
        f"{record['environments']} environments; parts in µs of CPU time.",
        "",
        "| | steps a second (best roll-out) | CPU µs a step | " + " | ".join(names) + " |",
        "|---|---|---|" + "---|" * len(names),
    ]
    lines += [_layout(name, run, names) for name, run in runs.items()]
    reached = runs["two cores"]["steps_per_second"]
    return [
        *lines,
        "",
        f"Wanted: 10,000 steps a second on two cores. Median {reached:,.0f}: {verdict(reached >= 10_000)}.",
    ]


def recipe(record: Record) -> list[str]:
    runs = record["layouts"]
    names = list(next(iter(next(iter(runs.values())).values()))["parts"])
    heads = " | ".join(f"{name}, µs" for name in names)
    lines = [
        f"| environments | | steps a second (best roll-out) | CPU µs a step | {heads} |",
        "|---|---|---|---|" + "---|" * len(names),
    ]
    for count, layouts, note in (
        *((count, layouts, "") for count, layouts in runs.items()),
        *(
            (count, layouts, ", beside a busy process")
            for count, layouts in record["beside_other_work"].items()
        ),
    ):
        lines += [_layout(f"{count} | {name}{note}", run, names) for name, run in layouts.items()]
    reached = max(layouts["two cores"]["steps_per_second"] for layouts in runs.values())
    best = max(layouts["two cores"]["steps_per_second_best"] for layouts in runs.values())
    lines += [
        "",
        f"Wanted: 25,000 steps a second on two cores. Median {reached:,.0f}, best roll-out {best:,.0f}: "
        f"{verdict(reached >= 25_000)}.",
    ]
    history = record["history"]
    if history is None:
        return lines
    rest, before, now = history["rest"], history["before"]["parts"], history["now"]["parts"]
    return [
        *lines,
        "",
        f"On one core, {history['environments']} environments, before (revision {history['revision'][:10]}) and now:",
        "",
        "| CPU µs a step | before | now |",
        "|---|---|---|",
        *(f"| {name} | {before[name]:.1f} | {now[name]:.1f} |" for name in names),
        f"| all but the physics | {rest['before']:.1f} | {rest['now']:.1f} ({history['ratio']:.2f} times less) |",
    ]
