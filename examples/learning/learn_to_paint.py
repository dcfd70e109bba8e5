"""A small network learns to paint, with PPO of stable-baselines3: an example, not a painter to use.

    pip install '.[env]' stable-baselines3
    python examples/learning/learn_to_paint.py [--steps 100000] [--seeds 0 1 2] [--out learned]

It learns on the renderer from four photographs, and is judged on a fifth that it never saw, and in the virtual studio.
Each stroke is rewarded by its own gain alone (gamma 0), so the network learns good next strokes, and plans nothing.
Writes learned.png, a chart, and learned.json.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import torch
from policies import GreedyPolicy, PlannerPolicy, RandomPolicy, VectorObservation, VectorObservations, play
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

import frida_painter as fp
from frida_painter_lab.targets import load_shipped_targets

LEARNED_FROM, HELD_OUT = ("astronaut", "cat", "coffee", "retina"), "rocket"
SETTINGS: dict[str, Any] = {"canvas": "12x9cm", "brush": "medium", "paints": 6, "strokes": 30, "rows": 32}
CELLS = 8


class Painters(VecEnv):
    """The project's vector environment, in the form of stable-baselines3."""

    def __init__(self, count: int, **settings: Any) -> None:
        self._envs = VectorObservations(fp.make_env("renderer/strokes-v1", num_envs=count, **settings), CELLS)
        super().__init__(count, self._envs.single_observation_space, self._envs.single_action_space)

    def reset(self):
        self._over = np.zeros(self.num_envs, bool)
        return self._envs.reset(seed=None if self._seeds[0] is None else [*self._seeds])[0]

    def step_async(self, actions):
        self._actions = actions

    def step_wait(self):
        # All episodes are equally long, so that after the last stroke one more step begins them all again.
        seen, reward, _, cut, info = self._envs.step(self._actions)
        infos = [{} for _ in range(self.num_envs)]
        if cut.all():
            for at, each in enumerate(infos):
                each |= {"terminal_observation": seen[at], "TimeLimit.truncated": True, "score": info["score"][at]}
            seen = self._envs.step(self._actions)[0]
        return seen, reward.astype(np.float32), cut, infos

    def close(self):
        self._envs.close()

    def get_attr(self, name, indices=None):
        return [getattr(self._envs, name, None)] * self.num_envs

    def set_attr(self, name, value, indices=None):
        raise NotImplementedError

    def env_method(self, name, *args, indices=None, **kwargs):
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False] * self.num_envs


class Scores(BaseCallback):
    """Keeps the mean score of the finished episodes, by the number of strokes painted so far."""

    def __init__(self) -> None:
        super().__init__()
        self.curve: list[tuple[int, float]] = []

    def _on_step(self) -> bool:
        scores = [info["score"] for info in self.locals["infos"] if "score" in info]
        if scores:
            self.curve.append((self.num_timesteps, float(np.mean(scores))))
        return True


def learn(seed: int, steps: int, count: int = 64) -> tuple[Any, list[tuple[int, float]]]:
    """Returns a trained policy and its learning curve."""
    goals = [target.picture for target in load_shipped_targets(LEARNED_FROM)]
    painters = Painters(count, goal=goals, **SETTINGS)
    painters.seed(seed)
    scores = Scores()
    model = PPO(
        "MlpPolicy", painters, n_steps=SETTINGS["strokes"], batch_size=count * SETTINGS["strokes"] // 4,
        n_epochs=5, gamma=0.0, gae_lambda=1.0, learning_rate=7e-4, ent_coef=1e-3, seed=seed, device="cpu",
        policy_kwargs={"net_arch": [128, 128], "log_std_init": -0.5},
    )  # fmt: skip
    model.learn(steps, callback=scores)
    return model, scores.curve


def main(steps: int, seeds: list[int], out: Path) -> None:
    torch.set_num_threads(1)
    goal = load_shipped_targets((HELD_OUT,))[0].picture
    tests = {name: fp.make_env(name, goal=goal, **SETTINGS) for name in ("renderer/strokes-v1", "studio/strokes-v1")}
    episodes = range(2)
    found: dict[str, Any] = {name: {} for name in tests}
    for name, env in tests.items():
        task = env.unwrapped.task
        others = {"random": RandomPolicy(0), "greedy": GreedyPolicy(task), "planner": PlannerPolicy(task)}
        for who, policy in others.items():
            found[name][who] = [each.score for each in play(env, policy, episodes)]
    curves = []
    for seed in seeds:
        model, curve = learn(seed, steps)
        curves.append(curve)
        for name, env in tests.items():
            vector = VectorObservation(env, CELLS)
            model.set_random_seed(seed)
            # Strokes are drawn, as in learning; the mean one would paint the same place again and again.
            policy = lambda seen, model=model: model.predict(seen)[0]  # noqa: E731
            found[name].setdefault("learned", []).extend(each.score for each in play(vector, policy, episodes))
    for name, scores in found.items():
        print(name, {who: f"{np.mean(each):.2f} dB" for who, each in scores.items()})
    out.with_suffix(".json").write_text(json.dumps({"scores": found, "curves": curves}))
    figure, axis = plt.subplots(figsize=(7, 4), layout="constrained")
    for seed, curve in zip(seeds, curves, strict=True):
        axis.plot(*np.array(curve).T, label=f"seed {seed}")
    axis.set(xlabel="strokes painted while learning", ylabel="PSNR of a finished canvas, dB")
    axis.legend(frameon=False)
    figure.savefig(out.with_suffix(".png"), dpi=130)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--out", type=Path, default=Path("learned"))
    options = parser.parse_args()
    main(options.steps, options.seeds, options.out)
