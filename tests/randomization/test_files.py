"""YAML in and out, its errors, and the generated page."""

from pathlib import Path

import numpy as np
import pytest

from randomization import (
    PRESETS,
    Direction,
    RandomizationError,
    Uniform,
    preset,
    read_randomization,
    write_randomization,
)
from randomization.table import page

OWN = """
extends: default
terms:
  kp: {distribution: uniform, low: 4, high: 6, source: ours}
  force: {distribution: direction, magnitude: {distribution: uniform, low: 0, high: 0.1}}
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "own.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_an_own_file_replaces_what_it_names(tmp_path):
    own, default = read_randomization(write(tmp_path, OWN)), preset("default")
    assert own.name == "own"
    assert own.terms["kp"].distribution == Uniform(4, 6) and own.terms["kp"].source == "ours"
    assert own.terms["force"].distribution == Direction(Uniform(0, 0.1))
    changed = {name for name in own.terms if own.terms[name] != default.terms[name]}
    assert changed == {"kp", "force"}
    assert preset(str(tmp_path / "own.yaml")) == own


def test_the_order_of_terms_is_the_documentation_s(tmp_path):
    own = read_randomization(write(tmp_path, OWN))
    assert list(own.terms) == list(preset("none").terms)


@pytest.mark.parametrize("name", PRESETS)
def test_writing_and_reading_gives_the_same(tmp_path, name):
    write_randomization(preset(name), tmp_path / "copy.yaml")
    copy = read_randomization(tmp_path / "copy.yaml")
    assert copy == preset(name) and copy.summary == preset(name).summary
    assert np.array_equal(copy.draw_steps(1, 3)["joint_noise"], preset(name).draw_steps(1, 3)["joint_noise"])


@pytest.mark.parametrize("name", PRESETS)
def test_every_value_of_a_preset_names_its_source(name):
    assert all(term.source for term in preset(name).terms.values())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("extend: default", r"own.yaml: extend: unknown key; nearest valid name: 'extends'"),
        ("extends: defualt", r"own.yaml: extends = 'defualt'"),
        (
            "terms: {kp: {distribution: constant, value: 5}}",
            r"own.yaml: no distribution for joint_offset, kd",
        ),
        (
            "extends: none\nterms: {tip_fricton: {}}",
            r"terms.tip_fricton: .*nearest valid name: 'tip_friction'",
        ),
        ("extends: none\nterms: {kp: {}}", r"terms.kp.distribution = None"),
        (
            "extends: none\nterms: {kp: {distribution: unifrom}}",
            r"'unifrom': .*nearest valid name: 'uniform'",
        ),
        (
            "extends: none\nterms: {kp: {distribution: uniform, lo: 1}}",
            r"terms.kp.lo: .*nearest valid name: 'low'",
        ),
        ("extends: none\nterms: {kp: {distribution: uniform, low: 1}}", r"terms.kp: uniform needs high"),
        ("extends: none\nterms: {kp: {distribution: uniform, low: 6, high: 5}}", r"terms.kp: low = 6"),
        ("extends: none\nterms: {kp: {distribution: constant, value: x}}", r"terms.kp: .*'x'"),
        ("extends: none\nterms: {kp: {distribution: constant, value: 50}}", r"allowed is \[0.5, 20\] Nm/rad"),
        ("extends: none\nterms: {kp: {distribution: constant, value: [5, 5]}}", r"kp has 2 numbers"),
        (
            "extends: none\nterms: {stick_friction: {distribution: constant, value: [0, 0, 0, 0, 0]}}",
            r"divide 12",
        ),
        (
            "extends: none\nterms: {kp: {distribution: direction, magnitude: 1}}",
            r"a direction is allowed for 3",
        ),
        ("extends: none\nterms: {kp: 5}", r"terms.kp = 5"),
        ("- a list", r"own.yaml: holds a list"),
        ("a: [", r"own.yaml: no valid YAML"),
    ],
)
def test_bad_files_are_refused_by_name(tmp_path, text, message):
    with pytest.raises(RandomizationError, match=message):
        read_randomization(write(tmp_path, text))


def test_a_missing_file_and_an_unknown_preset_are_refused(tmp_path):
    with pytest.raises(RandomizationError, match=r"absent.yaml: can't be read"):
        preset(str(tmp_path / "absent.yaml"))
    with pytest.raises(RandomizationError, match="nearest valid name: 'strong'"):
        preset("strog")


def test_the_committed_page_matches_the_data():
    committed = Path(__file__).parents[2] / "docs" / "randomization.md"
    assert committed.read_text(encoding="utf-8") == page(), "run `make docs` and commit the page"


def test_the_page_names_every_term_and_its_example_loads(tmp_path):
    text = page()
    assert all(text.count(f"| `{name}`") == 2 for name in preset("none").terms)
    example = text.split("```yaml\n")[1].split("```")[0]
    own = read_randomization(write(tmp_path, example))
    assert own.terms["tip_friction"].distribution == Uniform(0.3, 0.6)
