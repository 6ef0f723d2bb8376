"""Agents on disk: export, load, act alike; damaged or hostile directories are refused; warm starts."""

from __future__ import annotations

import json
import pickle
import resource
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load
from toy_task import ToyEnv

from tactile_kit.agents import Agent, AgentError, load_agent
from tactile_kit.agents.networks import InputLayout
from tactile_kit.agents.warm_start import column_map, warm_start
from tactile_kit.files import digest, tensor_bytes
from tactile_kit.runs.config import RunConfig
from tactile_kit.runs.export import export_agent
from tactile_kit.runs.training import make_learner

NETWORK = {"hidden": (32, 24)}


def config(**changes) -> RunConfig:
    learner = {"actor": NETWORK, "critic": NETWORK}
    return RunConfig.preset(
        "ppo-smoke", {"encoding": "none", "start_at_grasp": False, "ppo": learner, **changes}
    )


def export(directory: Path, env: ToyEnv | None = None, **changes):
    directory.mkdir(parents=True, exist_ok=True)
    settings = config(**changes)
    learner = make_learner(settings, env or ToyEnv(8))
    learner.learn(600)
    export_agent(directory, settings, learner, hours=0.01)
    return learner


def some(learner, count: int = 20) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(count, *learner.observation_space.shape)).astype(np.float32)


def test_a_loaded_agent_acts_as_the_learner_did(tmp_path: Path) -> None:
    learner = export(tmp_path)
    agent = load_agent(tmp_path)
    assert isinstance(agent, Agent) and agent.kind == "oracle" and agent.estimator is None
    assert agent.manifest.steps == learner.num_timesteps and agent.task.encoding == "none"
    observations = some(learner)
    actions = agent.act(observations)
    wanted, _ = learner.predict(observations, deterministic=True)
    assert actions.shape == (20, 12) and actions.dtype == np.float32
    np.testing.assert_allclose(actions, wanted, atol=1e-6)


def test_sampled_actions_need_and_follow_their_generator(tmp_path: Path) -> None:
    learner = export(tmp_path)
    agent, observations = load_agent(tmp_path), some(learner)
    first = agent.act(observations, deterministic=False, rng=np.random.default_rng(1))
    again = agent.act(observations, deterministic=False, rng=np.random.default_rng(1))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - agent.act(observations)).mean() > 0.01 and np.abs(first).max() <= 1
    with pytest.raises(AgentError, match="rng"):
        agent.act(observations, deterministic=False)
    with pytest.raises(AgentError, match="reads"):
        agent.act(observations[:, 1:])


def test_loading_leaves_the_global_generator_alone(tmp_path: Path) -> None:
    export(tmp_path)
    before = torch.get_rng_state()
    load_agent(tmp_path)
    assert torch.equal(before, torch.get_rng_state())


def edit(directory: Path, **changes) -> None:
    path = directory / "agent.json"
    data = json.loads(path.read_text())
    data.update(changes)
    path.write_text(json.dumps(data))


def replace_weights(directory: Path, data: bytes) -> None:
    (directory / "policy.safetensors").write_bytes(data)
    weights = json.loads((directory / "agent.json").read_text())["weights"]
    edit(directory, weights={**weights, "policy.safetensors": digest(data)})


def test_damaged_directories_are_refused(tmp_path: Path) -> None:
    export(tmp_path)
    policy, good = tmp_path / "policy.safetensors", (tmp_path / "policy.safetensors").read_bytes()
    manifest = (tmp_path / "agent.json").read_bytes()

    def refused(match: str) -> None:
        with pytest.raises(AgentError, match=match):
            load_agent(tmp_path)
        policy.write_bytes(good)
        (tmp_path / "agent.json").write_bytes(manifest)

    policy.write_bytes(good[:-1])
    refused("SHA-256")
    policy.unlink()
    refused("No such file")
    (tmp_path / "agent.json").write_text("{")
    refused("not JSON")
    edit(tmp_path, schema=2)
    refused("schema 2")
    edit(tmp_path, surprise=1)
    refused("surprise")
    edit(tmp_path, weights={"../policy.safetensors": "0", "policy.safetensors": "0"})
    refused("allowed")
    task = json.loads(manifest)["task"]
    edit(tmp_path, encoding="vec_bsp", task={**task, "encoding": "vec_bsp"})
    with pytest.raises(ValueError, match="vec_bps"):
        load_agent(tmp_path)
    (tmp_path / "agent.json").write_bytes(manifest)
    edit(tmp_path, task={"objets": "cube"})
    refused("objects")
    edit(tmp_path, kind="tactile")
    policy.write_bytes(tensor_bytes(load(good)))
    replace_weights(tmp_path, policy.read_bytes())
    refused("without an estimator")
    with pytest.raises(AgentError, match=r"agent\.json: no such file"):
        load_agent(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"encoding": "bps"}, "encoding 'bps' where task.encoding is 'none'"),
        ({"objects": "apple"}, "objects 'apple' where task.objects is 'cube'"),
        ({"encoding": "bps", "task.encoding": "bps"}, "weights of another agent"),
        ({"objects": "apple", "task.objects": "apple"}, "weights of another agent"),
        ({"seed": 7}, "weights of another agent"),
        ({"network.layers.activation": "relu"}, "weights of another agent"),
    ],
)
def test_what_weights_are_of_can_not_be_altered_alone(tmp_path: Path, changes: dict, match: str) -> None:
    """Evaluations would be called another agent's. Agents from before weights said so are read as ever."""
    export(tmp_path)
    whole, policy = json.loads((tmp_path / "agent.json").read_text()), tmp_path / "policy.safetensors"
    assert load_agent(tmp_path).manifest.identity in policy.read_bytes().decode("latin-1")
    data = json.loads(json.dumps(whole))
    for key, value in changes.items():
        *parents, name = key.split(".")
        place = data
        for parent in parents:
            place = place[parent]
        place[name] = value
    edit(tmp_path, **data)
    with pytest.raises(AgentError, match=match):
        load_agent(tmp_path)
    edit(tmp_path, **whole)
    replace_weights(tmp_path, tensor_bytes(load(policy.read_bytes())))
    edit(tmp_path, seed=7)
    assert load_agent(tmp_path).manifest.seed == 7


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        (
            {"network": {"layers": {"hidden": [10_000_000, 10_000_000]}, "squashed": False}},
            "less than or equal",
        ),
        ({"network": {"layers": {"hidden": [1] * 1000}, "squashed": False}}, "at most 32"),
        ({"network": {"layers": {"hidden": []}, "squashed": False}}, "at least 1"),
        ({"network": {"layers": {"hidden": [65_536] * 32}, "squashed": False}}, "do not fit"),
        (
            {"network": {"layers": {"hidden": [32, 24]}, "squashed": False, "actions": 10**9}},
            "less than or equal",
        ),
        ({"layout": [["joints", 10**12]]}, "less than or equal"),
        ({"layout": [["joints", -1]]}, "greater than or equal"),
        ({"layout": [["joints", 50_000]] * 100}, "layout of 5,000,000 numbers"),
        ({"layout": [["joints", 50_000]] * 10}, "do not fit"),
        ({"hours": float("inf")}, "Infinity is no number"),
    ],
)
def test_sizes_are_refused_before_anything_of_them_is_allocated(
    tmp_path: Path, changes: dict, match: str
) -> None:
    export(tmp_path)
    policy = tmp_path / "policy.safetensors"
    replace_weights(tmp_path, tensor_bytes(load(policy.read_bytes())))
    edit(tmp_path, **changes)
    begin, before = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(AgentError, match=match):
        load_agent(tmp_path)
    assert time.process_time() - begin < 2
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # KiB


class Bomb:
    def __reduce__(self):
        return (pytest.fail, ("unpickled",))


def test_weights_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    learner = export(tmp_path)
    state = learner.policy.actor.state_dict()
    replace_weights(tmp_path, pickle.dumps(Bomb()))
    with pytest.raises(AgentError, match="not a safetensors file"):
        load_agent(tmp_path)
    name = "mean.weight"
    for change, match in (
        (state[name][:, 1:], "do not fit"),
        (state[name].double(), "float64"),
        (state[name] * float("nan"), "NaN"),
    ):
        replace_weights(tmp_path, tensor_bytes({**state, name: change}))
        with pytest.raises(AgentError, match=match):
            load_agent(tmp_path)
    replace_weights(tmp_path, tensor_bytes({key: value for key, value in state.items() if key != name}))
    with pytest.raises(AgentError, match=r"mean\.weight"):
        load_agent(tmp_path)


def test_warm_start_with_more_terms_acts_as_its_source(tmp_path: Path) -> None:
    source = export(tmp_path)
    env = ToyEnv(8, sigma=2)
    learner = make_learner(config(seed=5), env)
    record = warm_start(learner, tmp_path, "none")
    assert record["steps"] == source.num_timesteps and record["as_initialised"] == []
    observations = some(source)
    wider = np.concatenate([observations, np.random.default_rng(1).normal(size=(20, 2)) * 9], 1).astype(
        np.float32
    )
    wanted, _ = source.predict(observations, deterministic=True)
    got, _ = learner.predict(wider, deterministic=True)
    np.testing.assert_allclose(got, wanted, atol=1e-6)
    with torch.no_grad():
        torch.testing.assert_close(
            learner.policy.predict_values(torch.from_numpy(wider)),
            source.policy.predict_values(torch.from_numpy(observations)), atol=1e-5, rtol=0,
        )  # fmt: skip
    norm = learner.policy.norm
    assert (norm.count[-2:] == 0).all() and (norm.count[:-2] > 0).all()


def test_a_warm_started_policy_can_learn_the_new_term(tmp_path: Path) -> None:
    export(tmp_path)
    learner = make_learner(config(seed=5), ToyEnv(8, sigma=2))
    warm_start(learner, tmp_path, "none")
    before = learner.policy.actor.trunk.layers[0].weight[:, -2:].clone()
    assert (before == 0).all()
    learner._setup_learn(10**6, None)
    transition_filled = [learner.env.step(np.zeros((8, 12), np.float32)) for _ in range(1)]
    assert transition_filled
    learner.learn(800)
    assert (learner.policy.norm.count[-2:] > 0).all()


def test_a_warm_start_from_a_mean_that_passes_a_tanh_is_refused(tmp_path: Path) -> None:
    """As older agents' does: its output means something else."""
    export(tmp_path)
    network = json.loads((tmp_path / "agent.json").read_text())["network"]
    edit(tmp_path, network={**network, "squashed": True})
    with pytest.raises(AgentError, match="passes a tanh"):
        warm_start(make_learner(config(), ToyEnv(8)), tmp_path, "none")


def test_a_chain_of_warm_starts_counts_all_steps_and_hours(tmp_path: Path) -> None:
    first = export(tmp_path / "first")
    record = warm_start(make_learner(config(), ToyEnv(8)), tmp_path / "first", "none")
    assert (record["from"], record["steps"], record["hours"]) == ("first", first.num_timesteps, 0.01)
    settings = config()
    second = make_learner(settings, ToyEnv(8))
    second.learn(600)
    (tmp_path / "second").mkdir()
    export_agent(tmp_path / "second", settings, second, hours=0.02, warm_start=record)
    record = warm_start(make_learner(config(), ToyEnv(8)), tmp_path / "second", "none")
    assert record["from"] == "second" and record["steps"] == first.num_timesteps + second.num_timesteps
    assert record["hours"] == pytest.approx(0.03)


@pytest.mark.parametrize("kept", [True, False])
def test_a_warm_started_ppo_keeps_sigma_unless_told_otherwise(tmp_path: Path, kept: bool) -> None:
    source = export(tmp_path)
    learner = make_learner(config(**{"ppo.log_std": -2.5, "ppo.keep_sigma": kept}), ToyEnv(8))
    warm_start(learner, tmp_path, "none")
    wanted = source.policy.actor.log_std if kept else torch.full((12,), -2.5)
    assert torch.equal(learner.policy.actor.log_std, wanted)
    assert not torch.equal(source.policy.actor.log_std, torch.full((12,), -2.5))


def test_warm_start_with_another_encoding_forgets_the_shape_only(tmp_path: Path) -> None:
    source = export(tmp_path)
    learner = make_learner(config(), ToyEnv(8))
    warm_start(learner, tmp_path, "pos")
    old, new = source.policy.actor.trunk.layers[0].weight, learner.policy.actor.trunk.layers[0].weight
    shape = source.env.layout.slice("shape")
    assert (new[:, shape] == 0).all()
    others = np.delete(np.arange(old.shape[1]), np.arange(shape.start, shape.stop))
    assert torch.equal(new[:, others], old[:, others])


def test_columns_follow_names() -> None:
    old, new = (("a", 2), ("b", 3)), (("b", 3), ("c", 1), ("a", 2))
    assert column_map(old, new, frozenset()) == [(slice(2, 5), slice(0, 3)), (slice(0, 2), slice(4, 6))]
    assert column_map(old, new, frozenset({"b"})) == [(slice(0, 2), slice(4, 6))]
    assert column_map(old, (("a", 4),), frozenset()) == []
    assert InputLayout(old).size == 5
