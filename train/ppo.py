"""Proximal policy optimisation by stable-baselines3 on `vec_env`; all robots share one policy.

The library learns; this module adds our worlds, schedules, clock and files. The library's files hold pickles, so ours
are used instead: a policy folder, and checkpoints of plain arrays. Resuming restores the networks and the optimizer;
the worlds start again.
"""

import math
import warnings

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from agents.networks import first_actor_critic, tensors_of
from train.books import book_of
from train.learning.config import PPOConfig
from train.learning.progress import TrainingTally
from train.learning.trainer import Split, Trainer, network_of, set_threads
from train.learning.worlds import TrainingSimulator
from warehouse_env.envs.vector import WarehouseVecEnv


class MeasuredVecEnv(VecEnvWrapper):
    """Scales rewards, counts what happens, and measures the simulator's time."""

    def __init__(self, venv: WarehouseVecEnv, reward_scale: float, split: Split, tally: TrainingTally) -> None:
        super().__init__(venv)
        self._scale, self._split, self._tally = np.float32(reward_scale), split, tally

    def reset(self) -> VecEnvObs:
        """Reset all worlds."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """Step all worlds; rewards are scaled, the counts are of the rewards as they were."""
        with self._split.measure("simulator_s"):
            observation, reward, done, infos = self.venv.step_wait()
        self._tally.add()
        return observation, reward * self._scale, done, infos


class Ppo(Trainer):
    """The trainer: one `update` is one rollout and some epochs over its rows."""

    def __init__(self, config: PPOConfig) -> None:
        self.config, self.split, self.rollout = config, Split(), config.rollout
        set_threads(config.threads)
        mixes = config.worlds(config.rows)
        self.env = mixes[0][0]
        with self.split.measure("simulator_s"):
            rest = config.jam_seconds, config.shared
            self._simulators = [TrainingSimulator(*one, *rest, book_of(one[0])) for one in mixes]
            self.tallies = [TrainingTally(self._simulators)]
            worlds = WarehouseVecEnv(self._simulators)
            worlds.seed(config.seed)
        self.rows = worlds.num_envs
        self.network = network_of(self.env, config.hidden)
        self._step_size = config.learning_rate
        self._worlds = MeasuredVecEnv(worlds, config.reward_scale, self.split, self.tallies[0])
        self.model = self._make_model()
        self.net, self.names = self.model.policy, self._names()
        self.load_policy(tensors_of(first_actor_critic(self.network, self.env, config.cruise_bias)))
        self.optimizer = self.model.policy.optimizer
        _, self._callback = self.model._setup_learn(1)

    def _make_model(self) -> PPO:
        config, widths, samples = self.config, list(self.config.hidden), self.config.rollout * self.rows
        warnings.filterwarnings("ignore", "You have specified a mini-batch size", UserWarning)  # the last is shorter
        shape = {"net_arch": {"pi": widths, "vf": widths}, "activation_fn": torch.nn.Tanh, "log_std_init": -0.7}
        model = PPO(
            "MlpPolicy", self._worlds, learning_rate=lambda _: self._step_size, n_steps=config.rollout,
            batch_size=math.ceil(samples / max(1, round(samples / config.minibatch))), n_epochs=config.epochs,
            gamma=config.gamma, gae_lambda=config.gae_lambda, clip_range=config.clip, ent_coef=config.entropy_first,
            max_grad_norm=config.gradient_clip,
            policy_kwargs=shape, seed=config.seed, device="cpu",
        )  # fmt: skip
        model.set_logger(Logger(folder=None, output_formats=[]))
        return model

    def update(self, number: int, spent: float) -> dict[str, float]:
        """Collect one rollout and learn from it (see `Trainer.update`)."""
        set_threads(self.config.threads)  # another trainer of this process may have other needs
        model, weights = self.model, self.config.reward(spent)
        self._step_size, model.ent_coef = self.config.step_size(spent), self.config.entropy(spent)
        for simulator in self._simulators:
            simulator.reward_weights = weights
        simulated = self.split.seconds["simulator_s"]
        with self.split.measure("policy_s"):
            model.collect_rollouts(self._worlds, self._callback, model.rollout_buffer, model.n_steps)
        self.split.seconds["policy_s"] -= self.split.seconds["simulator_s"] - simulated
        with self.split.measure("update_s"):
            model.train()
        values = model.logger.name_to_value
        names = {"policy_gradient_loss": "actor_loss", "value_loss": "critic_loss", "clip_fraction": "clip_fraction"}
        losses = {ours: float(values[f"train/{theirs}"]) for theirs, ours in names.items()}
        losses |= {"entropy": -float(values["train/entropy_loss"])}
        return losses | {"explained_variance": float(values["train/explained_variance"])}

    def close(self) -> None:
        """End the worlds (see `Trainer.close`)."""
        self._worlds.close()

    def _names(self) -> dict[str, str]:
        """Return our tensor names -> the library's: its hidden layers stand at every second place of a Sequential."""
        depth, names = len(self.config.hidden), {} if self.network.discrete else {"log_std": "log_std"}
        for ours, hidden, last in (("actor", "policy_net", "action_net"), ("critic", "value_net", "value_net")):
            for kind in ("weight", "bias"):
                for layer in range(depth):
                    names[f"{ours}.{layer}.{kind}"] = f"mlp_extractor.{hidden}.{2 * layer}.{kind}"
                names[f"{ours}.{depth}.{kind}"] = f"{last}.{kind}"
        return names
