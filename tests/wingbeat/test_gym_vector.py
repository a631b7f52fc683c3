"""The vector environment: each vehicle has the numbers of an environment of its own."""

from __future__ import annotations

import multiprocessing
from typing import Any

import numpy as np
import pytest

from sim_bridge.sensors.noise import BLOCK
from wingbeat.errors import InputError

gymnasium = pytest.importorskip("gymnasium")
ID = "wingbeat.gym:wingbeat/Flapping-v0"


def make(size: int, **arguments: Any) -> Any:
    return gymnasium.make_vec(ID, num_envs=size, time_limit=0.4, handover=0.6, **arguments)


def actions(size: int, steps: int) -> np.ndarray:
    drawn = np.random.default_rng(0).uniform(-1.0, 1.0, (steps, size, 4))
    return (drawn * (0.3, 0.5, 0.5, 1.0)).astype(np.float32)


@pytest.mark.parametrize(
    "arguments",
    [
        {"turbulence": "light", "wind": 1.0, "vibration": 1.0},
        pytest.param({"vehicle": "arizona_100cm", "handover": 1.0, "vibration": 1.0}, marks=pytest.mark.validate),
    ],
)
def test_each_vehicle_equals_single_environment(arguments: dict[str, Any]) -> None:
    """GIVEN two vehicles and two single environments with the same seeds and actions WHEN they fly for two
    episodes THEN observations, rewards, ends and information are the same."""
    settings = {"handover": 0.6, "time_limit": 0.4, **arguments}
    batch = gymnasium.make_vec(ID, num_envs=2, **settings)
    singles = [gymnasium.make(ID, **settings) for _ in range(2)]
    observed, _ = batch.reset(seed=5)
    starts = [env.reset(seed=5 + i)[0] for i, env in enumerate(singles)]
    assert np.array_equal(observed, starts)
    for step, action in enumerate(actions(2, 30)):
        observed, rewards, terminated, truncated, infos = batch.step(action)
        for i, env in enumerate(singles):
            if step == 20:  # the episodes of 0.4 s ended in the step before
                one, reward, ended, late, info = env.reset()[0], 0.0, False, False, {}
            else:
                one, reward, ended, late, info = env.step(action[i])
            assert observed[i] == pytest.approx(one, rel=1e-5, abs=1e-5)
            assert rewards[i] == pytest.approx(reward, abs=1e-5)
            assert (terminated[i], truncated[i]) == (ended, late)
            assert late == (step == 19)
            assert all(infos[name][i] == value and infos[f"_{name}"][i] for name, value in info.items())


def test_result_is_independent_of_threads_and_batch() -> None:
    runs = []
    for size, threads in ((9, 1), (5, 3)):
        env = make(size, launches=2, threads=threads, turbulence="moderate")
        env.reset(seed=list(range(size)))
        runs.append([env.step(action[:size])[0][:5] for action in actions(9, 30)])
    assert np.array_equal(runs[0], runs[1])


def test_launches_repeat_from_a_finite_set() -> None:
    env = make(8, launches=2)
    first, _ = env.reset(seed=1)
    assert len(np.unique(first, axis=0)) == 2


def test_gusts_continue_across_noise_blocks() -> None:
    """GIVEN gusts drawn in blocks of 256 ticks WHEN a vehicle flies through two of them THEN it equals a single
    environment at each step."""
    settings = {"handover": 0.6, "turbulence": "severe", "time_limit": 4.0}
    batch, single = gymnasium.make_vec(ID, num_envs=1, **settings), gymnasium.make(ID, **settings)
    batch.reset(seed=3)
    single.reset(seed=3)
    cruise = np.array([0.0, 0.0, 0.0, 1.0], np.float32)
    blocks = set()
    for _ in range(140):
        observed, _, ended, late, _ = batch.step(cruise[None])
        one = single.step(cruise)[0]
        assert not ended[0] and not late[0]
        assert observed[0] == pytest.approx(one, rel=1e-4, abs=1e-4)
        blocks.add(int(batch.unwrapped._batch.arrays.gust_ticks[0]) // BLOCK)
    assert len(blocks) >= 3


def test_ground_contact_ends_episode() -> None:
    env = gymnasium.make_vec(ID, num_envs=2, handover=0.6, launches=1)
    env.reset(seed=1)
    dive = np.array([[-1.0, 0.0, 0.0, -1.0], [0.0, 0.0, 0.0, 1.0]], np.float32)
    for _ in range(300):
        _, rewards, terminated, _, _ = env.step(dive)
        if terminated.any():
            break
    assert terminated.tolist() == [True, False] and rewards[0] == -10.0


def test_same_step_mode_returns_final_observation() -> None:
    mode = gymnasium.vector.AutoresetMode.SAME_STEP
    env, reference = make(2, launches=1, autoreset_mode=mode), make(2, launches=1)
    start, _ = env.reset(seed=3)
    reference.reset(seed=3)
    for action in actions(2, 20):
        observed, _, _, truncated, infos = env.step(action)
        last = reference.step(action)[0]
    assert truncated.all() and np.array_equal(observed, start)
    assert np.array_equal(np.stack(infos["final_obs"]), last)
    assert infos["final_info"]["time"][0] > infos["time"][0]


def test_disabled_mode_resets_by_mask() -> None:
    env = make(2, launches=1, autoreset_mode=gymnasium.vector.AutoresetMode.DISABLED)
    env.reset(seed=3)
    for action in actions(2, 20):
        before, _, _, truncated, _ = env.step(action)
    assert truncated.all()
    with pytest.raises(InputError, match="reset the vehicles"):
        env.step(action)
    after, infos = env.reset(options={"reset_mask": np.array([True, False])})
    assert np.array_equal(after[1], before[1]) and not np.array_equal(after[0], before[0])
    assert infos["_time"].tolist() == [True, False]


def test_sticks_that_are_not_finite_are_ignored() -> None:
    env, single = make(1), gymnasium.make(ID, time_limit=0.4, handover=0.6)
    env.reset(seed=4)
    single.reset(seed=4)
    for value in (0.5, np.nan, np.nan):
        action = np.array([value, 0.0, 0.0, 0.5], np.float32)
        observed, one = env.step(action[None])[0], single.step(action)[0]
    assert observed[0, :11] == pytest.approx(one[:11], rel=1e-5, abs=1e-5)


def _steps_in_child(env: Any, queue: Any) -> None:
    queue.put(env.step(actions(8, 1)[0])[0])


def test_batch_steps_after_fork() -> None:
    """GIVEN a batch whose threads run WHEN the process forks THEN the child steps with threads of its own."""
    env = make(8, launches=1, threads=2)
    env.reset(seed=1)
    env.step(actions(8, 1)[0])
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    child = context.Process(target=_steps_in_child, args=(env, queue))
    child.start()
    stepped = queue.get(timeout=60)
    child.join(60)
    assert np.array_equal(stepped, env.step(actions(8, 1)[0])[0])


def test_faults_are_refused() -> None:
    with pytest.raises(InputError, match="faults"):
        make(1, faults=["tail_stuck@9"])


def test_vortex_lattice_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wingbeat.gym.vector.is_compiled_separately", lambda name: True)
    with pytest.raises(InputError, match="aerodynamic model strip_theory"):
        make(1, launches=1).reset(seed=1)
