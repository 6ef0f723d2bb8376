"""What learners and tools of other people expect of environments: seeds, bad actions, copies, pictures."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from stable_baselines3 import PPO

import tactile_kit
from tactile_kit.task.actions import ActionError
from tactile_kit.task.config import TaskConfig
from tactile_kit.task.env import ReorientEnv

TASK = TaskConfig(objects="cube", encoding="none")


@pytest.fixture
def batch():
    env = tactile_kit.make_vec(TASK, num_envs=2, num_workers=0, seed=3)
    yield env
    env.close()


def first_episodes(env):
    env.reset()
    return [env.episodes.present[i].seed for i in range(2)]


def test_seed_changes_the_episodes_and_repeats_them(batch):
    own = first_episodes(batch)
    assert batch.seed(7) == [7, 7]
    seven = first_episodes(batch)
    batch.seed(8)
    eight = first_episodes(batch)
    batch.seed(7)
    assert first_episodes(batch) == seven
    batch.seed(3)
    assert first_episodes(batch) == own
    assert len({*own, *seven, *eight}) == 6
    following = first_episodes(batch)
    assert batch.seed() == [3, 3] and first_episodes(batch) != following  # None: on they go


def test_seed_leaves_a_list_alone(batch):
    batch.reset()
    specs = [batch.episodes.present[0], batch.episodes.present[1]]
    listed = tactile_kit.make_vec(TASK, num_envs=2, num_workers=0, episodes=specs)
    listed.seed(5)
    assert first_episodes(listed) == [spec.seed for spec in specs]
    listed.close()


def test_seed_of_a_learner(batch):
    """Stable-Baselines3's own PPO hands its seed on."""

    def learn(seed):
        model = PPO("MlpPolicy", batch, n_steps=2, batch_size=4, seed=seed, device="cpu")
        model.learn(4)
        return [batch.episodes.present[i].seed for i in range(2)], model.policy.state_dict()[
            "action_net.bias"
        ].numpy()

    (one, first), (two, second), (other, _) = learn(1), learn(1), learn(2)
    assert one == two and one != other
    assert np.array_equal(first, second)


BAD = [np.zeros(11), np.zeros((1, 12)), np.zeros((12, 2)), 0.0, ["a"] * 12, None, np.zeros(12, complex)]


@pytest.mark.parametrize("action", BAD, ids=[str(np.shape(action)) + str(type(action)) for action in BAD])
def test_actions_of_another_shape(action, batch):
    env = ReorientEnv(TASK)
    env.reset(seed=1)
    with pytest.raises(ActionError, match=r"allowed are numbers of shape \(12,\)"):
        env.step(action)
    env.close()
    batch.reset()
    with pytest.raises(ActionError, match=r"allowed are numbers of shape \(2, 12\)"):
        batch.step(action)
    batch.step(np.zeros((2, 12)))  # nothing was half sent


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_actions_that_are_not_finite(value, batch):
    """An error where there is one environment; in a batch the fault of the one, while the others go on."""
    env = ReorientEnv(TASK)
    env.reset(seed=1)
    action = np.zeros(12)
    action[4] = value
    with pytest.raises(ActionError, match="allowed are finite numbers"):
        env.step(action)
    assert np.isfinite(env.step(np.zeros(12))[0]).all()
    env.close()
    batch.reset()
    observations, _, dones, infos = batch.step(np.stack([np.zeros(12), action]))
    assert (
        dones.tolist() == [False, True] and "is not finite" in infos[1]["fault"] and not infos[1]["success"]
    )
    assert np.isfinite(observations).all()
    assert not batch.step(np.zeros((2, 12)))[2].any()


def test_copies_of_an_environment():
    env = ReorientEnv(TASK)
    for twin in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        assert twin.config == env.config
        assert np.array_equal(twin.reset(seed=5)[0], ReorientEnv(TASK).reset(seed=5)[0])
        twin.close()
    env.reset(seed=5)
    for copied in (copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError, match="has been reset can't be copied"):
            copied(env)
    env.close()


def test_copies_of_a_made_environment():
    env = gymnasium.make("tactile_kit/Reorient-v0", objects="cube", encoding="none")
    twin = copy.deepcopy(env)
    assert np.array_equal(twin.reset(seed=5)[0], env.reset(seed=5)[0])
    env.close(), twin.close()


def test_a_batch_says_why_it_cannot_be_copied(batch):
    for copied in (copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError, match="its physics live in worker processes"):
            copied(batch)


def test_render_mode_of_a_batch():
    env = tactile_kit.make_vec(TASK, num_envs=1, num_workers=0, render_mode=None)
    assert env.render_mode is None
    env.close()
    with pytest.raises(ValueError, match="render_mode = 'rgb_array': allowed is None"):
        tactile_kit.make_vec(TASK, render_mode="rgb_array")
