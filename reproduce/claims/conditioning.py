"""Claims 13, 14 and 16: being told a wrong mesh, and being taken to another simulator."""

from __future__ import annotations

import numpy as np

import randomization
from reproduce.cells import paper_values, percent
from reproduce.claims.verdict import (
    CLEAR,
    MANY,
    NOT_REPRODUCED,
    REPRODUCED,
    NotMeasured,
    Test,
    Verdict,
    count,
    minus,
    must_have_learned,
    needed,
    signed,
)
from reproduce.inventory import TACTILE, TRANSFER
from reproduce.results import Results
from tactile_kit.evaluation.intervals import stratified_bootstrap
from tactile_kit.evaluation.rows import EpisodeRow
from tactile_kit.evaluation.summary import group, success_rate

NEAR, FAR = 0.0125, 0.0175  # m from the median, of the furthest extent (which is at most 0.0225 m away)


def wrong_size_hurts(results: Results) -> Verdict:
    """13: from near to far extents success falls by 10 points with the fixed mesh, by 5 at most with the right one.

    Far from the median the fixed mesh must do clearly worse than the right one, whatever the sizes do by themselves.
    """
    median = paper_values("extent")["median"]
    counts = {}
    for evaluation in ("extent-true", "extent-fixed"):
        rows = needed(results, TACTILE, evaluation)
        away = [abs(row.furthest_extent - median) for row in rows]
        counts[evaluation, "near"] = count(
            [r for r, a in zip(rows, away, strict=True) if a <= NEAR], f"{evaluation}, near"
        )
        counts[evaluation, "far"] = count(
            [r for r, a in zip(rows, away, strict=True) if a >= FAR], f"{evaluation}, far"
        )
    must_have_learned({"correct mesh, near": counts["extent-true", "near"]})
    falls = {e: minus(counts[e, "far"], counts[e, "near"]) for e in ("extent-true", "extent-fixed")}
    far = minus(counts["extent-fixed", "far"], counts["extent-true", "far"])
    figures = (
        "far (1.75 cm or more off the median) less near (1.25 cm or less):"
        f" fixed mesh {signed(*falls['extent-fixed'])}, correct mesh"
        f" {signed(*falls['extent-true'])}; far, fixed less correct {signed(*far)}"
    )
    n = sum(c.episodes for c in counts.values())
    fixed, right = falls["extent-fixed"], falls["extent-true"]
    if fixed[0] > -MANY or right[0] < -CLEAR or far[0] > -CLEAR:
        return Verdict(NOT_REPRODUCED, figures, n)
    if fixed[2] >= 0 or far[2] >= 0:
        raise NotMeasured(f"too few episodes to tell; {figures}", n)
    return Verdict(REPRODUCED, figures, n)


def own_mesh_is_best(results: Results) -> Verdict:
    """14: own mesh above the others on average, and for no object (but 6) another mesh clearly better."""
    rows = needed(results, TACTILE, "confusion")
    own = count([row for row in rows if row.given_id == row.object_id], "own mesh")
    others = count([row for row in rows if row.given_id != row.object_id], "other meshes")
    must_have_learned({"own mesh": own})
    exception = paper_values("confusion")["exception"]["manipulated"]
    pairs = group(rows, lambda row: (row.given_id, row.object_id))
    objects = sorted({held for _, held in pairs})
    best, beaten = 0, []
    for held in objects:
        mine = count(pairs.get((held, held), []), f"object {held} under its own mesh")
        rivals = {
            given: count(found, "") for (given, h), found in pairs.items() if h == held and given != held
        }
        best += all(rival.rate <= mine.rate for rival in rivals.values())
        # Bonferroni over an object's rivals: with a dozen of them one looks better by luck.
        confident = [given for given, rival in rivals.items() if _clearly_better(rival, mine, len(rivals))]
        if confident and held != exception:
            beaten.append(held)
    gap = minus(own, others)
    figures = (
        f"own mesh {own}, other meshes {others}, difference {signed(*gap)}; own mesh best or equal for {best} of"
        f" {len(objects)} objects; clearly beaten: {', '.join(map(str, beaten)) or 'none'}"
    )
    holds = gap[1] > 0 and not beaten and best >= len(objects) - 1
    return Verdict(REPRODUCED if holds else NOT_REPRODUCED, figures, len(rows))


def _clearly_better(rival, mine, comparisons: int) -> bool:
    from tactile_kit.evaluation.intervals import difference

    confidence = 1 - 0.05 / comparisons
    return difference(rival.successes, rival.episodes, mine.successes, mine.episodes, confidence).low > 0


def survives_transfer(results: Results) -> Verdict:
    """16: mean over objects of transfer less simulation within 5 points, or its interval around zero and narrow."""
    here, there = needed(results, TACTILE, "nominal"), needed(results, TACTILE, TRANSFER)
    must_have_learned({"simulation": count(here, "simulation")})
    shared = {r.object_id for r in here} & {r.object_id for r in there}
    if not shared:
        raise NotMeasured("no object evaluated in both simulators", len(there))
    strata = [_successes(rows, held) for rows in (there, here) for held in sorted(shared)]

    def gap(parts: list[np.ndarray]) -> float:
        means = [part.mean() for part in parts]
        return float(np.mean(means[: len(shared)]) - np.mean(means[len(shared) :]))

    generator = randomization.stream(results.seed, "bootstrap", "claim 16")
    low, high = map(float, stratified_bootstrap(strata, gap, generator=generator))
    value = gap(strata)
    figures = f"other simulator less this one, mean over {len(shared)} objects {signed(value, low, high)}"
    if high - low > 6 * CLEAR:
        raise NotMeasured(f"too few episodes to tell; {figures}", len(here) + len(there))
    holds = low > -2 * CLEAR and (abs(value) <= CLEAR or low <= 0 <= high)
    return Verdict(
        REPRODUCED if holds else NOT_REPRODUCED,
        figures + f" of {percent(success_rate(here).value, 1)}",
        len(here) + len(there),
    )


def _successes(rows: list[EpisodeRow], held: int) -> np.ndarray:
    return np.array([row.success for row in rows if row.object_id == held], dtype=np.float64)


TESTS: dict[int, Test] = {13: wrong_size_hurts, 14: own_mesh_is_best, 16: survives_transfer}
