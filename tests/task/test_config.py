"""Settings: refused where wrong, with the nearest name; own randomisation files."""

from __future__ import annotations

import re

import pytest
from pydantic import ValidationError

import randomization
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.core import Core
from tactile_kit.task.vec_env import make_vec


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"horizn": 5}, "horizn: unknown; nearest valid name: 'horizon'"),
        ({"reward": {"rotaton": 1.0}}, "rotaton: unknown; nearest valid name: 'rotation'"),
        ({"simulation": {"steps_per_secnd": 60}}, "nearest valid name: 'steps_per_second'"),
        ({"randomization": "defalt"}, "nearest valid name: 'default'"),
        ({"randomization": "absent.yaml"}, "absent.yaml: can't be read"),
        ({"simulation": {"steps_per_second": 100}}, "steps_per_second = 100: allowed are multiples of 60"),
        ({"extent_range": (0.09, 0.045)}, "extent_range = (0.09, 0.045)"),
        ({"horizon": 0}, "horizon"),
        ({"goals": "cubic"}, "'so3' or 'octahedral'"),
        ({"gravity": float("nan")}, "gravity"),
    ],
)
def test_wrong_settings_are_named(settings: dict, message: str) -> None:
    with pytest.raises(ValidationError, match=re.escape(message)):
        TaskConfig(**settings)


def test_settings_are_frozen_and_come_back_from_plain_data() -> None:
    config = TaskConfig(objects="cube", reward={"position": 4.0}, simulation={"steps_per_second": 240})
    with pytest.raises(ValidationError):
        config.horizon = 3  # type: ignore[misc]
    assert TaskConfig(**config.model_dump(mode="json")) == config


def test_make_vec_checks_settings_on_top_of_a_config() -> None:
    with pytest.raises(ValidationError, match="nearest valid name: 'horizon'"):
        make_vec(TaskConfig(objects="cube"), horizn=5)
    with pytest.raises(ValidationError, match="horizon"):
        make_vec(TaskConfig(objects="cube"), horizon=-1)


def own_file(folder, terms: str):
    path = folder / "own.yaml"
    path.write_text(f"extends: none\nterms:\n  {terms}\n", encoding="utf-8")
    return str(path)


def test_an_own_randomisation_file_is_used(tmp_path, variants) -> None:
    path = own_file(tmp_path, "kp: {distribution: constant, value: 4.25}")
    config = TaskConfig(objects="cube,l_shape", horizon=5, grasps=2, randomization=path)
    simulator = Core(config, variants=variants).blueprint.build()
    simulator.reset(0, 0, 9.81)
    assert simulator.physics["kp"] == 4.25
    simulator.close()


def test_a_faulty_randomisation_file_is_an_error_at_once(tmp_path) -> None:
    path = own_file(tmp_path, "kq: {distribution: constant, value: 4.25}")
    with pytest.raises(ValidationError, match=r"own.yaml: terms.kq: unknown term; nearest valid name: 'kp'"):
        TaskConfig(randomization=path)


@pytest.mark.parametrize("name", randomization.PRESETS)
def test_presets_leave_the_size_alone(variants, name: str) -> None:
    Core(TaskConfig(objects="cube,l_shape", grasps=2, randomization=name), variants=variants)
