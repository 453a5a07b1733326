"""PPO on a GPU in plain PyTorch: `python examples/ppo_gpu.py --device cuda --worlds 4096 --steps 1_000_000_000`.

The whole of it: rollouts, advantages and updates stay on the device. `--device cpu` runs the same on a CPU. The policy
is saved as a folder that every command takes: `warehouse evaluate --policy runs/ppo_gpu --robots 16`.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import torch

import warehouse_env
from agents.networks import ActorCritic, first_actor_critic, tensors_of
from agents.weights_folder import Network, PolicyRecord, save_policy
from train.cli import run_script
from warehouse_env import EnvConfig, RewardWeights, SensorSpec, TrafficSpec
from warehouse_env.checked import Checked
from warehouse_env.envs.tensors import WarehouseTensorEnv

LAMBDA, CLIP, ENTROPY = 0.95, 0.2, 0.003  # of the advantages, of the ratio of probabilities, weight in the loss


@dataclass(frozen=True)
class Options(Checked):
    """Options of the training."""

    ranges: ClassVar = {
        "worlds": (1, 1_000_000), "steps": (1, 10**12), "rollout": (1, 10_000), "minibatches": (1, 10_000),
        "learning_rate": (0.0, 1.0), "gamma": (0.0, 1.0), "seed": (0, 2**32 - 1),
    }  # fmt: skip
    device: str = "cuda"
    """Device by torch's name of it."""
    worlds: int = 4096
    """Worlds that are stepped at a time."""
    robots: int = 16
    """Robots in a world."""
    layout: str = "paper46"
    """Floor."""
    shield: bool = False
    """Let the shield veto motions that could touch."""
    steps: int = 100_000_000
    """Agent-steps (decisions of one robot)."""
    rollout: int = 32
    """Env steps between two updates."""
    minibatches: int = 8
    """Minibatches of an update, which sees each sample once."""
    learning_rate: float = 7e-4
    """Step size of Adam at the start; it falls linearly to 0."""
    gamma: float = 0.98
    """Discount of one decision."""
    collision: float = -30.0
    """Reward of a contact."""
    seed: int = 0
    """Seed of worlds, networks and actions."""
    out: Path = Path("runs/ppo_gpu")
    """Folder of the policy."""


class Rollout:
    """What one rollout has seen, [T, rows, ...] on the device."""

    def __init__(self, length: int, env: WarehouseTensorEnv) -> None:
        shape, device = (length, env.num_envs), env.device
        size = env.simulator.observation.shape[-1]
        self.observation = torch.empty((*shape, size), device=device)
        self.action = torch.empty(shape, dtype=torch.int64, device=device)
        self.logp, self.value, self.reward = (torch.empty(shape, device=device) for _ in range(3))
        self.last = torch.empty(shape, dtype=torch.bool, device=device)
        self.next_value = torch.empty(shape, device=device)

    @torch.no_grad()
    def fill(self, env: WarehouseTensorEnv, net: ActorCritic) -> None:
        """Drive the worlds on."""
        seen = env.simulator.observation.view(env.num_envs, -1)
        for t in range(len(self.reward)):
            self.observation[t] = seen
            chances = torch.distributions.Categorical(logits=net.output(seen))
            self.action[t] = action = chances.sample()
            self.logp[t], self.value[t] = chances.log_prob(action), net.value(seen)
            seen, reward, _, last, infos = env.step(action)
            self.reward[t], self.last[t] = reward, last
            # a truncated episode goes on in truth, so the value of its last observation counts
            self.next_value[t] = net.value(infos.get("final_obs", seen))

    def advantages(self, gamma: float) -> torch.Tensor:
        """Return generalised advantages [T, rows] (Schulman et al. 2016, eq. 16)."""
        surprise = self.reward + gamma * self.next_value - self.value
        out, ahead = torch.empty_like(surprise), torch.zeros_like(surprise[0])
        for t in reversed(range(len(surprise))):
            out[t] = ahead = surprise[t] + gamma * LAMBDA * ahead * ~self.last[t]
        return out


def update(net: ActorCritic, optimiser: torch.optim.Optimizer, seen: Rollout, o: Options) -> None:
    """Take one pass of clipped policy gradient over a rollout."""
    gain = seen.advantages(o.gamma)
    target = (gain + seen.value).flatten()
    gain = ((gain - gain.mean()) / (gain.std() + 1e-8)).flatten()
    observation, action, old = seen.observation.flatten(0, 1), seen.action.flatten(), seen.logp.flatten()
    for rows in torch.randperm(len(gain), device=gain.device).chunk(o.minibatches):
        logp, entropy = net.judge(net.output(observation[rows]), action[rows])
        ratio = (logp - old[rows]).exp()
        clipped = ratio.clamp(1 - CLIP, 1 + CLIP)
        policy = -torch.minimum(ratio * gain[rows], clipped * gain[rows]).mean()
        value = (net.value(observation[rows]) - target[rows]).square().mean()
        optimiser.zero_grad(set_to_none=True)
        (policy + 0.5 * value - ENTROPY * entropy.mean()).backward()
        torch.nn.utils.clip_grad_norm_(net.parameters(), 0.5)
        optimiser.step()


def main(o: Options) -> None:
    """Train, print a line a minute or so, and save the policy."""
    torch.manual_seed(o.seed)
    config = EnvConfig(
        num_agents=o.robots, layout=o.layout, max_steps=2000, traffic=TrafficSpec(shield=o.shield),
        sensor=SensorSpec(predictions=True), reward=RewardWeights(collision=o.collision),
    )  # fmt: skip
    env = warehouse_env.tensor_env(o.worlds, config, device=o.device)
    env.reset(seed=o.seed)
    network = Network(env.single_observation_space.shape[0], int(env.single_action_space.n), True)
    net = first_actor_critic(network, config, 0.0).to(env.device)
    optimiser = torch.optim.Adam(net.parameters(), lr=o.learning_rate, eps=1e-5)
    seen, begun, done = Rollout(o.rollout, env), time.time(), 0
    said = begun
    while done < o.steps:
        seen.fill(env, net)
        for group in optimiser.param_groups:
            group["lr"] = o.learning_rate * (1 - done / o.steps)
        update(net, optimiser, seen, o)
        done += seen.reward.numel()
        if time.time() - said > 20 or done >= o.steps:
            said = time.time()
            print(f"{done:,} agent-steps, {done / (said - begun):,.0f} a second, reward {seen.reward.mean():.4f}")
    record = PolicyRecord("ppo_gpu", network, config, training={"steps": done, "seconds": time.time() - begun})
    print(f"wrote {save_policy(o.out, record, tensors_of(net.cpu()))}")


if __name__ == "__main__":
    run_script(Options, main)
