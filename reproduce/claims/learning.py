"""Claims 1 to 7: learning curves of oracle agents (Fig. 5). A line's score: its mean over the last tenth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from reproduce.artefacts.learning import CURVES, ends, usable
from reproduce.cells import percent
from reproduce.claims.verdict import CLEAR, LEARNED, NOT_REPRODUCED, REPRODUCED, NotMeasured, Test, Verdict
from reproduce.results import Results
from reproduce.style import line_of

TOLERANCE = 0.02  # "at least as well": not more than two points of success behind
BPS = ("vec_bps", "bps")


def scores(results: Results, objects: str, lines: Sequence[str], seeds: int = 2) -> dict[str, np.ndarray]:
    """Scores (seeds,) of each line at the step that all of them have reached.

    ``NotMeasured`` where a line is missing, has fewer seeds than asked for, or nothing was learned by any.
    """
    curves = {line: usable(results.curves(f"oracle-{line}-{objects}")) for line in lines}
    missing = [line_of(line)[1] for line, found in curves.items() if not found]
    if missing:
        raise NotMeasured(f"missing on {objects}: {', '.join(missing)}", unit="seeds")
    last = min(curve.steps[-1] for found in curves.values() for curve in found)
    values = {line: ends(found, last) for line, found in curves.items()}
    said = f"on {objects} after {last} steps: {said_scores(values)}"
    total = sum(map(len, values.values()))
    fewest = min(map(len, values.values()))
    if fewest < seeds:
        raise NotMeasured(f"{fewest} seed(s) a line, {seeds} or more are needed; {said}", total, "seeds")
    if max(value.mean() for value in values.values()) < LEARNED:
        raise NotMeasured(f"no line has learned enough yet to be compared; {said}", total, "seeds")
    return values


def said_scores(values: dict[str, np.ndarray]) -> str:
    return ", ".join(f"{line_of(line)[1]} {percent(value.mean(), 1)}" for line, value in values.items())


def _seeds(*values: dict[str, np.ndarray]) -> int:
    return sum(len(v) for group in values for v in group.values())


def _verdict(holds: bool, figures: str, n: int) -> Verdict:
    return Verdict(REPRODUCED if holds else NOT_REPRODUCED, figures, n, "seeds")


def bps_at_least_as_good(results: Results) -> Verdict:
    """1: neither BPS encoding falls behind any other by more than the tolerance, on any object set."""
    holds, said, n = True, [], 0
    for objects, lines in CURVES.items():
        values = scores(results, objects, lines)
        best_other = max(values[line].mean() for line in lines if line not in BPS)
        holds &= min(values[line].mean() for line in BPS) >= best_other - TOLERANCE
        said.append(f"{objects}: {said_scores(values)}")
        n += _seeds(values)
    return _verdict(bool(holds), "; ".join(said), n)


def marginal_on_cube(results: Results) -> Verdict:
    """2: on the cube VecBPS and Pos differ by less than 5 points."""
    values = scores(results, "cube", ("vec_bps", "pos"))
    gain = values["vec_bps"].mean() - values["pos"].mean()
    return _verdict(
        -TOLERANCE <= gain < CLEAR, f"gain {percent(gain, 1)} ({said_scores(values)})", _seeds(values)
    )


def grows_with_set(results: Results) -> Verdict:
    """3: the gain of VecBPS over Pos is larger on Geometric 8 than on the cube."""
    values = {objects: scores(results, objects, ("vec_bps", "pos")) for objects in CURVES}
    gains = {objects: v["vec_bps"].mean() - v["pos"].mean() for objects, v in values.items()}
    said = ", ".join(f"{objects} {percent(gain, 1)}" for objects, gain in gains.items())
    holds = gains["geometric8"] > max(gains["cube"], 0) + TOLERANCE
    return _verdict(bool(holds), f"gain over Pos: {said}", _seeds(*values.values()))


def beats_pointnet(results: Results) -> Verdict:
    """4: BPS clearly above PointNet, which is above Pos by less than half of what BPS is above Pos (Geometric 8)."""
    values = scores(results, "geometric8", ("bps", "pointnet", "pos"))
    mean = {line: value.mean() for line, value in values.items()}
    gain, other = mean["bps"] - mean["pos"], mean["pointnet"] - mean["pos"]
    holds = _clearly(values, "bps", "pointnet") and -TOLERANCE <= other < gain / 2
    return _verdict(bool(holds), said_scores(values), _seeds(values))


def rotation_does_not_help(results: Results) -> Verdict:
    """5: PosRot no better than Pos on Geometric 8, and more spread between seeds."""
    values = scores(results, "geometric8", ("pos_rot", "pos"), seeds=3)
    spread = {line: float(np.ptp(value)) for line, value in values.items()}
    holds = values["pos_rot"].mean() <= values["pos"].mean() + TOLERANCE and spread["pos_rot"] > spread["pos"]
    said = (
        f"{said_scores(values)}; largest less smallest seed: PosRot {percent(spread['pos_rot'], 1)}, Pos"
        f" {percent(spread['pos'], 1)}"
    )
    return _verdict(bool(holds), said, _seeds(values))


def mesh_does_not_help(results: Results) -> Verdict:
    """6: Mesh no better than Pos on Geometric 8."""
    values = scores(results, "geometric8", ("mesh", "pos"))
    return _verdict(
        bool(values["mesh"].mean() <= values["pos"].mean() + TOLERANCE), said_scores(values), _seeds(values)
    )


def position_helps(results: Results) -> Verdict:
    """7: Pos clearly above None on Geometric 8."""
    values = scores(results, "geometric8", ("pos", "none"))
    return _verdict(_clearly(values, "pos", "none"), said_scores(values), _seeds(values))


def _clearly(values: dict[str, np.ndarray], better: str, worse: str) -> bool:
    """By 5 points in the mean, and the worst seed above the other line's mean: so few seeds have no interval."""
    gain = values[better].mean() - values[worse].mean()
    return bool(gain >= CLEAR and values[better].min() > values[worse].mean())


TESTS: dict[int, Test] = {
    1: bps_at_least_as_good,
    2: marginal_on_cube,
    3: grows_with_set,
    4: beats_pointnet,
    5: rotation_does_not_help,
    6: mesh_does_not_help,
    7: position_helps,
}
