"""Our trainers, REINFORCE and PPO: policy gradients that differ in their loss. All robots share one policy.

Each thread plays its own worlds and computes the gradient of its own rows. Threads meet only to add the gradients, in
order. That is faster than threads within each small operation, also on a busy machine. A device has one worker with all
worlds, whose rollouts, advantages and updates stay there.

The critic's value continues the return after each rollout. The advantage A is the generalised one (Schulman et al.
2016); with gae_lambda = 1 it is exactly the truncated return minus the baseline.
"""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple, TypeVar

import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.networks import ActorCritic
from train.learning import checkpoint
from train.learning.config import ThreadedConfig, ThreadedPPOConfig
from train.learning.trainer import Split, Trainer, first_net, network_of, rng_of, set_threads, shuffled
from train.learning.worlds import TrainingSimulator, TrainingWorlds
from warehouse_env.config import EnvConfig, RewardWeights

_JUDGED = 1_000_000  # rows whose values are computed at once, which bounds the memory


class Rollout(NamedTuple):
    """What T decisions of R robots leave for the update; rows are T x R."""

    observation: Tensor  # float32[T * R, D]
    action: Tensor  # int64[T * R] or float32[T * R, 2]
    log_probability: Tensor  # float32[T * R], of the action when it was drawn
    advantage: Tensor  # float32[T * R]
    target: Tensor  # float32[T * R], of the critic: the return


def advantages(
    reward: Tensor, value: Tensor, ended: Tensor, last_value: Tensor, gamma: float, gae_lambda: float
) -> Tensor:
    """Return generalised advantages float32[T, R] (Schulman et al. 2016, eq. 16).

    A_t = d_t + gamma lambda A_{t+1},  d_t = r_t + gamma V(o_{t+1}) - V(o_t); an ended episode cuts the sum.

    reward: float32[T, R]. value: float32[T + 1, R], V(o_t); the last row continues the return. ended: bool[T, R], the
    episode was cut after the step (o_{t+1} is then the first of the next one). last_value: float32[T, R], V of the cut
    episode's last observation, where `ended`. gamma, gae_lambda: discount and weight.
    """
    out = reward + gamma * torch.where(ended, last_value, value[1:]) - value[:-1]
    keep = gamma * gae_lambda * ~ended
    for t in range(len(out) - 2, -1, -1):
        out[t] += keep[t] * out[t + 1]
    return out


class RolloutWorker:
    """Worlds and buffers of one thread, or of a device."""

    def __init__(self, config: ThreadedConfig, worlds: TrainingWorlds) -> None:
        """Make the buffers of `config.rollout` decisions, T, where the worlds are."""
        self._config, self.worlds, self.split, self.rows = config, worlds, Split(), worlds.rows
        shape, new = (config.rollout, worlds.rows), worlds.reward
        self._observation = new.new_zeros((config.rollout + 1, *worlds.observation.shape))
        discrete = config.action_type == "discrete"
        self._action = new.new_zeros(shape, dtype=torch.int64) if discrete else new.new_zeros((*shape, 2))
        self._log_probability, self._reward, self._last_value = (new.new_zeros(shape) for _ in range(3))
        self._ended = new.new_zeros(shape, dtype=torch.bool)

    @torch.no_grad()
    def collect(self, net: ActorCritic, weights: RewardWeights, seed: list[int]) -> Rollout:
        """Let all robots act for one rollout, with draws by `seed`. Its tensors are overwritten by the next one."""
        rng, worlds = rng_of(seed, self._config.device), self.worlds
        worlds.set_reward(weights)
        self._ended.zero_()
        for t in range(self._config.rollout):
            self._observation[t] = worlds.observation
            with self.split.measure("policy_s"):
                output = net.output(self._observation[t])
                self._action[t], self._log_probability[t] = net.draw(output, rng)
            with self.split.measure("simulator_s"):
                ends = worlds.step(self._action[t])
            self._reward[t] = worlds.reward
            for rows, observation in ends:
                self._ended[t, rows] = True
                self._last_value[t, rows] = net.value(observation)
        self._observation[-1] = worlds.observation
        with self.split.measure("policy_s"):
            return self._judge(net)

    def _judge(self, net: ActorCritic) -> Rollout:
        config = self._config
        parts = torch.split(self._observation.flatten(0, 1), _JUDGED)
        value = torch.cat([net.value(part) for part in parts]).view(-1, self.rows)
        reward = self._reward * config.reward_scale
        advantage = advantages(reward, value, self._ended, self._last_value, config.gamma, config.gae_lambda)
        drawn = (self._observation[:-1], self._action, self._log_probability)
        return Rollout(*(tensor.flatten(0, 1) for tensor in (*drawn, advantage, advantage + value[:-1])))


T = TypeVar("T")
FIGURES = ("actor_loss", "critic_loss", "entropy", "clip_fraction", "gradient_norm")

ActorLoss = Callable[[Tensor, Tensor, Tensor], tuple[Tensor, Tensor]]
"""Returns the loss whose gradient drives the actor, and the share of rows that it holds back.

Its arguments are float32[M]: log pi(a | o) as the policy stands and as it was when the action was drawn, and the
advantage scaled to mean 0 and deviation 1.
"""


def policy_loss(log_probability: Tensor, old: Tensor, advantage: Tensor) -> tuple[Tensor, Tensor]:
    """Return -E[A log pi(a | o)] (Williams 1992) and 0, for no row is held back (see `ActorLoss`)."""
    return -(advantage * log_probability).mean(), advantage.new_zeros(())


def clipped_loss(log_probability: Tensor, old: Tensor, advantage: Tensor, clip: float) -> tuple[Tensor, Tensor]:
    """Return -E[min(r A, clip(r, 1 - e, 1 + e) A)] with the ratio r = pi(a | o) / pi_old(a | o) (Schulman et al. 2017,
    eq. 7), and the share of rows whose ratio is clipped (see `ActorLoss`).
    """
    ratio = (log_probability - old).exp()
    within = ratio.clamp(1.0 - clip, 1.0 + clip)
    loss = -torch.minimum(ratio * advantage, within * advantage).mean()
    return loss, ((ratio - 1.0).abs() > clip).float().mean()


class ThreadedTrainer(Trainer):
    """Workers, network and optimizer. One `update` is one rollout and `epochs` passes over its rows."""

    net: ActorCritic

    def __init__(self, config: ThreadedConfig) -> None:
        self.config, self.rollout, self.epochs = config, config.rollout, 1
        self._actor_loss: ActorLoss = policy_loss
        if isinstance(config, ThreadedPPOConfig):
            self._actor_loss, self.epochs = partial(clipped_loss, clip=config.clip), config.epochs
        self._threads = config.threads if config.device else 1  # of torch: a worker beside others has one
        set_threads(self._threads)
        self._workers = [RolloutWorker(config, worlds) for worlds in _worlds(config)]
        self._pool = ThreadPoolExecutor(len(self._workers), initializer=set_threads, initargs=(self._threads,))
        self.rows = sum(worker.rows for worker in self._workers)
        self.tallies = [worker.worlds.tally for worker in self._workers]
        worlds = self._workers[0].worlds
        self.env, device = worlds.simulators[0].config, worlds.observation.device
        self.network = network_of(self.env, config.hidden)
        if device.type == "cuda":  # 10 bits of mantissa; the 7 of bfloat16 would change probabilities by up to 9%
            torch.backends.cuda.matmul.allow_tf32 = True
        torch.manual_seed(config.seed)
        self.net = first_net(config, self.env).to(device)
        self.names = {name: name for name in self.net.state_dict()}
        self._sizes = [parameter.numel() for parameter in self.net.parameters()]
        self._groups = [self.net.actor_parameters(), list(self.net.critic.parameters())]
        self.optimizer = torch.optim.Adam([{"params": group} for group in self._groups], eps=1e-5)
        self.split = self._workers[0].split  # the other threads' are much like it

    def _each(self, work: Callable[..., T], *arguments: Iterable[Any]) -> list[T]:
        """Return what a function returns for each worker's arguments, called side by side; a single one's is here."""
        run = self._pool.map if len(self._workers) > 1 else map
        return list(run(work, *arguments))

    def update(self, number: int, spent: float) -> dict[str, float]:
        """Collect one rollout and take the passes of gradient steps over it (see `Trainer.update`)."""
        config = self.config
        set_threads(self._threads)
        weights = config.reward(spent)
        seeds = [[config.seed, k, number] for k in range(len(self._workers))]
        rollouts = self._each(lambda one, seed: one.collect(self.net, weights, seed), self._workers, seeds)
        with self.split.measure("update_s"):
            step_size = config.step_size(spent)
            for group, factor in zip(self.optimizer.param_groups, (1.0, config.critic_factor), strict=True):
                group["lr"] = factor * step_size
            return self._learn(rollouts, [config.seed, len(rollouts), number], config.entropy(spent))

    def _learn(self, rollouts: list[Rollout], seed: list[int], entropy_weight: float) -> dict[str, float]:
        mean, spread = joint_scale([rollout.advantage for rollout in rollouts])
        rollouts = [one._replace(advantage=(one.advantage - mean) / spread) for one in rollouts]
        pieces = max(1, round(self.rows * self.rollout / self.config.minibatch))
        rng, totals = rng_of(seed, self.config.device), mean.new_zeros(len(FIGURES))
        for _ in range(self.epochs):
            orders = [shuffled(len(one.target), rng).tensor_split(pieces) for one in rollouts]
            for chosen in zip(*orders, strict=True):
                totals += self._descend(rollouts, chosen, entropy_weight)
        target = torch.cat([rollout.target for rollout in rollouts])
        figures = dict(zip(FIGURES, (totals / (self.epochs * pieces)).tolist(), strict=True))
        return {**figures, "explained_variance": 1.0 - 2.0 * figures["critic_loss"] / target.var().item()}

    def _descend(self, rollouts: list[Rollout], chosen: Iterable[Tensor], entropy_weight: float) -> Tensor:
        """Take one gradient step by the chosen rows of each rollout; return FIGURES."""
        parts = self._each(lambda one, rows: self.gradient(one, rows, entropy_weight), rollouts, chosen)
        slopes = torch.split(torch.stack([slope for slope, _ in parts]), self._sizes, dim=1)
        for parameter, own in zip(self.net.parameters(), slopes, strict=True):
            parameter.grad = own.contiguous().mean(0).view_as(parameter)
        norm, _ = [torch.nn.utils.clip_grad_norm_(group, self.config.gradient_clip) for group in self._groups]
        self.optimizer.step()
        return torch.cat([torch.stack([figures for _, figures in parts]).mean(0), norm[None]])

    def gradient(self, rollout: Rollout, rows: Tensor, entropy_weight: float) -> tuple[Tensor, Tensor]:
        """Return means over some rows of a rollout: slopes float32[P] of all parameters, and all FIGURES but the norm.

        The rollout's advantages are scaled already.
        """
        net, observation = self.net, rollout.observation[rows]
        log_probability, entropy = net.judge(net.output(observation), rollout.action[rows])
        actor_loss, held = self._actor_loss(log_probability, rollout.log_probability[rows], rollout.advantage[rows])
        critic_loss = 0.5 * (net.value(observation) - rollout.target[rows]).square().mean()
        mean_entropy = entropy.mean()
        loss = actor_loss - entropy_weight * mean_entropy + critic_loss
        slopes = torch.cat([slope.flatten() for slope in torch.autograd.grad(loss, list(self.net.parameters()))])
        return slopes, torch.stack([actor_loss, critic_loss, mean_entropy, held]).detach()

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return network, optimizer and the worlds' histories (see `Trainer.arrays`)."""
        worlds = {
            f"worlds.{number}.{name}": array
            for number, worker in enumerate(self._workers)
            for name, array in worker.worlds.history().items()
        }
        return {**super().arrays(), **worlds}

    def load(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Put back what `arrays` returned; the worlds replay their last actions."""
        super().load(arrays)
        histories = [checkpoint.part_of(arrays, f"worlds.{number}.") for number in range(len(self._workers))]
        self._each(lambda worker, history: worker.worlds.replay(history), self._workers, histories)

    def close(self) -> None:
        """End the threads (see `Trainer.close`)."""
        self._pool.shutdown()


def _worlds(config: ThreadedConfig) -> Iterator[TrainingWorlds]:
    """Make the worlds of each thread, or all of them on a device."""
    shaping: dict[str, Any] = {name: getattr(config, name) for name in ("jam_seconds", "shared", "late_braking")}
    if config.device is not None:
        from train.learning.device_worlds import DeviceWorlds, TrainingDevice

        mixes = config.worlds(config.rows)
        yield DeviceWorlds(partial(TrainingDevice, **shaping), mixes, [config.seed, 0], config.device)
        return
    here = partial(TrainingSimulator, **shaping)
    for number, mixes in enumerate(shares(config)):
        yield TrainingWorlds(here, mixes, [config.seed, number], config.floor_episodes)


def shares(config: ThreadedConfig) -> list[list[tuple[EnvConfig, int]]]:
    """Return what each thread trains on: whole mixes if they divide evenly, since a few large simulators are faster
    than many small ones, else its share of each.
    """
    mixes, threads = config.worlds(config.rows), config.threads
    if len(mixes) % threads == 0:
        return [mixes[number::threads] for number in range(threads)]
    return [config.worlds(config.rows / threads) for _ in range(threads)]


def joint_scale(advantage: list[Tensor]) -> tuple[Tensor, Tensor]:
    """Return the mean and standard deviation of all advantages together."""
    joined = torch.cat(advantage)
    return joined.mean(), joined.std() + 1e-8
