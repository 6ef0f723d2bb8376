"""Scales as data: the shipped ones plan what the paper needs; mistakes are named with what is allowed."""

from __future__ import annotations

import json

import pytest

from reproduce.artefacts.learning import CURVES
from reproduce.errors import ReproduceError, ScaleError
from reproduce.files import ROOT, read_yaml
from reproduce.inventory import ABLATED, BENCHMARK, NEEDS, PLANNER, inventory
from reproduce.plan import ARTEFACTS, default_out, make_plan
from reproduce.prepare import prepare, weight
from reproduce.scales import load_scale, parse_scale, split_variant
from reproduce.settings import run_settings, training_grasps
from tactile_kit.runs import RunConfig
from tactile_kit.simulation.engines import engine_of
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.variants import finder_of

SCALES = ("smoke", "small", "paper")


@pytest.mark.parametrize("name", SCALES)
def test_every_run_of_the_paper_is_planned(name, tmp_path):
    plan = make_plan(load_scale(name), "scratch", tmp_path)
    roles = {run.role for run in plan.runs}
    assert {*BENCHMARK, *ABLATED.values()} <= roles
    curves = {run.role for run in plan.runs if run.curves and run.kind == "oracle"}
    assert {f"oracle-{line}-{objects}" for objects, lines in CURVES.items() for line in lines} <= curves
    assert set(NEEDS) == set(ARTEFACTS)
    made = {(e.run.role, e.group.name) for e in plan.evaluations}
    for artefact, (pairs, _) in NEEDS.items():
        assert {pair for pair in pairs if pair[0] != PLANNER} <= made, artefact


@pytest.mark.parametrize("name", SCALES)
def test_settings_say_what_the_name_says(name, tmp_path):
    plan = make_plan(load_scale(name), "scratch", tmp_path)
    for run in plan.runs:
        settings = run_settings(plan, run)
        encoding, variation = split_variant(run.variant)
        assert (settings["kind"], settings["seed"], settings["task"]["encoding"]) == (
            run.kind,
            run.seed,
            encoding,
        )
        assert settings["task"]["scaling"] == ("nominal" if run.set == "cube" else "random")
        assert settings["task"]["objects"] == ("geometric8" if run.set == "geometric8" else "cube")
        assert settings["task"]["sigma_in_observation"] == (variation != "nosigma")
        assert settings["estimator"]["stop_gradient"] == (variation == "stopgrad")
        if variation == "fingers":
            assert settings["estimator"]["cell"] == "fingers"


def test_learning_curves_that_are_compared_are_trained_alike(tmp_path):
    for name in SCALES:
        plan = make_plan(load_scale(name), "scratch", tmp_path)
        for objects in CURVES:
            compared = [
                run_settings(plan, run)
                for run in plan.runs
                if run.kind == "oracle" and run.set == objects and run.curves
            ]
            alike = [
                {key: value for key, value in settings.items() if key not in ("seed", "task")}
                | {"task": {k: v for k, v in settings["task"].items() if k != "encoding"}}
                for settings in compared
            ]
            assert all(settings == alike[0] for settings in alike), (name, objects)


def test_small_stays_within_its_budget(tmp_path):
    plan = make_plan(load_scale("small"), "scratch", tmp_path)
    assert 5000 <= sum(map(weight, plan.evaluations)) <= 8000


def test_papers_sizes(tmp_path):
    plan = make_plan(load_scale("paper"), "scratch", tmp_path)
    sizes = {e.group.name: weight(e) for e in plan.evaluations if e.run.role == "tactile-vec_bps-geometric8"}
    assert sizes["nominal"] == 13 * 24 * 256 and sizes["confusion"] == 13 * 13 * 24 * 256
    assert sizes["complex"] == 3 * 24 * 256 and sizes["extent-true"] == sizes["extent-fixed"] == 512 * 5 * 24
    assert len({run.name for run in plan.runs if run.kind == "oracle"}) == 57


def test_scales_write_to_folders_of_their_own():
    folders = [default_out(scale, source) for scale in SCALES for source in ("pretrained", "scratch")]
    results = ROOT / "results"
    assert default_out("small", "pretrained") == results
    assert [folder for folder in folders if folder == results] == [results]


def test_preparing_again_touches_nothing_and_a_change_touches_its_job_only(tmp_path):
    scale = load_scale("smoke")
    prepare(make_plan(scale, "scratch", tmp_path))
    jobs = tmp_path / ".pipeline" / "jobs"
    before = {file: file.stat().st_mtime_ns for file in jobs.rglob("*.yaml")}
    prepare(make_plan(scale, "scratch", tmp_path))
    assert {file: file.stat().st_mtime_ns for file in jobs.rglob("*.yaml")} == before
    groups = [
        g.model_copy(update={"goals_per_case": 5}) if g.name == "complex" else g for g in scale.evaluations
    ]
    prepare(make_plan(scale.model_copy(update={"evaluations": tuple(groups)}), "scratch", tmp_path))
    changed = {
        file.relative_to(jobs).as_posix() for file, at in before.items() if file.stat().st_mtime_ns != at
    }
    assert changed == {
        f"evaluate/{role}-s0/complex.yaml"
        for role in ("oracle-vec_bps-geometric8", "tactile-vec_bps-geometric8")
    }


def test_shipped_agents_are_found_and_the_rest_is_missing(tmp_path):
    agents = tmp_path / "agents"
    there = agents / "oracle-vec_bps-geometric8-s0"
    there.mkdir(parents=True)
    (there / "agent.json").write_text(json.dumps({"task": {"objects": "geometric8"}, "steps": 5}))
    plan = make_plan(load_scale("small"), "pretrained", tmp_path / "out", agents)
    content = inventory(plan, "table1")
    assert content["runs"]["oracle-vec_bps-geometric8-s0"]["agent"] == str(there / "agent.json")
    assert content["runs"]["tactile-pos-geometric8-s0"]["agent"] is None
    assert content["episodes"]["tactile-pos-geometric8-s0/nominal"] is None
    config = json.loads(prepare(plan).read_text())
    wanted = {f"{there.name}/nominal", f"{there.name}/complex"}
    if engine_of("mujoco").installed:
        wanted.add(f"{there.name}/mujoco")
    assert set(config["evaluate"]) == wanted and config["train"] == {}


@pytest.mark.parametrize(
    "change, words",
    [
        ({"evaluatons": []}, ["evaluatons", "nearest valid name: 'evaluations'"]),
        (
            {"runs": [{"kind": "oracle", "variants": ["vecbps"], "sets": ["cube"], "preset": "oracle"}]},
            ["vecbps", "vec_bps"],
        ),
        (
            {"runs": [{"kind": "oracle", "variants": ["bps"], "sets": ["cube"], "preset": "oracel"}]},
            ["oracel", "'oracle'"],
        ),
        (
            {
                "runs": [
                    {"kind": "oracle", "variants": ["bps"], "sets": ["cube"], "preset": "oracle", "seed": 1}
                ]
            },
            ["seed", "'seeds'"],
        ),
        ({"num_envs": 0}, ["num_envs", "0", "greater than 0"]),
    ],
)
def test_mistakes_are_named(change, words):
    content = read_yaml(ROOT / "reproduce" / "scales" / "smoke.yaml") | change
    with pytest.raises(ScaleError) as error:
        parse_scale(content, "mine.yaml")
    assert all(word in str(error.value) for word in ["mine.yaml", *words]), str(error.value)


def test_unknown_scales_runs_and_files_are_named(tmp_path):
    with pytest.raises(ScaleError, match="nearest valid name: 'small'"):
        load_scale("smal")
    with pytest.raises(ReproduceError, match=r"nowhere\.yaml"):
        load_scale(str(tmp_path / "nowhere.yaml"))
    scale = load_scale("smoke")
    group = scale.evaluations[1].model_copy(update={"runs": ("oracle-vecbps-geometric8",)})
    with pytest.raises(ScaleError, match="nearest valid name: 'oracle-vec_bps-geometric8'"):
        make_plan(scale.model_copy(update={"evaluations": (group,)}), "scratch", tmp_path)


def test_pupils_wait_for_their_teacher(tmp_path):
    plan = make_plan(load_scale("small"), "scratch", tmp_path)
    pupil = next(run for run in plan.runs if run.role == "oracle-pos-geometric8")
    teacher = pupil.directory.parent / "oracle-vec_bps-geometric8-s0"
    assert run_settings(plan, pupil)["ppo"]["teacher"] == str(teacher)
    assert json.loads(prepare(plan).read_text())["train"][pupil.job]["after"] == [teacher.name]
    groups = [group.model_copy(update={"warm_start": None}) for group in plan.scale.runs]
    lone = plan.scale.model_copy(update={"runs": tuple(groups)})
    jobs = json.loads(prepare(make_plan(lone, "scratch", tmp_path)).read_text())["train"]
    assert jobs[pupil.job]["after"] == [teacher.name]
    missing = groups[1].model_copy(update={"teacher": "oracle-vecbps-{set}-s{seed}"})
    with pytest.raises(ScaleError, match=r"teacher .*nearest valid name: 'oracle-vec_bps-geometric8-s0'"):
        make_plan(
            plan.scale.model_copy(update={"runs": (groups[0], missing, *groups[2:])}), "scratch", tmp_path
        )


def test_a_wrong_run_setting_names_scale_and_preset(tmp_path):
    scale = load_scale("smoke")
    scale = scale.model_copy(
        update={"presets": {**scale.presets, "oracle": {"preset": "ppo-smoke", "step": 3}}}
    )
    plan = make_plan(scale, "scratch", tmp_path)
    with pytest.raises(ScaleError, match=r"scale smoke, preset oracle.*step"):
        run_settings(plan, plan.runs[0])


@pytest.mark.parametrize(("engine", "drag"), [("bullet", 0.0), ("compiled", 20.0)])
def test_the_grasps_of_a_training_are_those_of_its_physics(engine, drag):
    episodes = {"engine": engine, "grasps": 5, "grasp_spread": 0.1, "drag": drag}
    run = RunConfig.build({"objects": "cube", "scaling": "nominal", "episodes": episodes})
    name, settings = training_grasps(run.to_dict())
    played = run.played
    assert finder_of(TaskConfig(**settings)) == finder_of(played)
    assert settings["simulation"]["engine"] == engine and name.startswith("cube-nominal-")
    thinner = RunConfig.build(
        {"objects": "cube", "scaling": "nominal", "episodes": {**episodes, "drag": drag / 2}}
    )
    assert training_grasps(thinner.to_dict()) == (name, settings)  # shared
