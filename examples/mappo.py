"""MAPPO in one file of plain PyTorch (Yu et al. 2022): `python examples/mappo.py`.

All robots share an actor, which sees a robot's own observation, and a critic, which also sees the whole world
(`vec_env.state()`). Values are learned in units of the returns' running mean and spread. Commands take the folder that
it writes: `warehouse evaluate --policy runs/mappo greedy --robots 16`.

Its own worlds, with `--steps 1_500_000`: 56 goals per robot-hour and 8.1 collisions/km after 0.18 million agent-steps,
137 and 0.7 after 1.1 million (five minutes on busy cores), 138 and 0.9 after 1.5 million.
"""

from __future__ import annotations

import itertools
import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import torch
from torch import nn

import warehouse_env
from agents.weights_folder import Network, PolicyRecord, save_policy
from train.cli import run_script
from warehouse_env.checked import Checked

GAMMA, LAMBDA, CLIP, ENTROPY = 0.98, 0.95, 0.2, 0.003  # ENTROPY: its weight in the loss
ROLLOUT, EPOCHS, MINIBATCHES = 48, 4, 6  # decisions of a robot between updates, passes over them, parts of a pass


@dataclass(frozen=True)
class Options(Checked):
    """Options of the training."""

    ranges: ClassVar = {"worlds": (1, 10**5), "steps": (1, 10**12), "learning_rate": (0.0, 1.0), "seed": (0, 10**9)}
    worlds: int = 12
    """Worlds that are stepped at a time."""
    robots: int = 16
    """Robots in a world."""
    layout: str = "paper46"
    """Floor."""
    steps: int = 1_000_000
    """Agent-steps (decisions of one robot)."""
    learning_rate: float = 1e-3
    """Step size of Adam at the start; it falls linearly to 0."""
    seed: int = 0
    """Seed of worlds, networks and actions."""
    out: Path = Path("runs/mappo")
    """Folder of the policy."""


class MLP(nn.ModuleList):
    """Dense layers with tanh between them."""

    def __init__(self, *sizes: int, last_gain: float) -> None:
        super().__init__(nn.Linear(*pair) for pair in itertools.pairwise(sizes))
        for number, layer in enumerate(self, 1):
            nn.init.orthogonal_(layer.weight, last_gain if number == len(self) else math.sqrt(2))
            nn.init.zeros_(layer.bias)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Return float32[..., outputs] from float32[..., inputs]."""
        for layer in list(self)[:-1]:
            x = torch.tanh(layer(x))
        return self[-1](x)


class Agent(nn.Module):
    """An actor and a central critic, whose values are in units of the running mean and spread of the returns."""

    def __init__(self, inputs: int, whole: int, actions: int) -> None:
        super().__init__()
        self.actor = MLP(inputs, 64, 64, actions, last_gain=0.01)
        self.critic = MLP(inputs + whole, 128, 128, 1, last_gain=1.0)
        self.mean, self.spread = 0.0, 1.0

    def value(self, seen: torch.Tensor, whole: torch.Tensor) -> torch.Tensor:
        """Return float32[rows] from observations float32[rows, inputs] and states float32[rows, S]."""
        return self.mean + self.spread * self.critic(torch.cat((seen, whole), -1)).squeeze(-1)


def advantages(reward: torch.Tensor, value: torch.Tensor, done: torch.Tensor) -> torch.Tensor:
    """Return generalised advantages [T, rows] (Schulman et al. 2016); value: [T + 1, rows]."""
    gain, ahead = torch.empty_like(reward), torch.zeros_like(reward[0])
    for t in reversed(range(len(reward))):
        surprise = reward[t] + GAMMA * value[t + 1] * ~done[t] - value[t]
        gain[t] = ahead = surprise + GAMMA * LAMBDA * ~done[t] * ahead
    return gain


def main(o: Options) -> None:
    """Train, print a line every twenty updates, and save the policy."""
    torch.set_num_threads(1)  # the simulator has its own threads; torch's would slow both down
    torch.manual_seed(o.seed)
    worlds = warehouse_env.vec_env(o.worlds, warehouse_env.LEARNING, num_agents=o.robots, layout=o.layout)
    worlds.seed(o.seed)
    inputs, actions, rows = worlds.observation_space.shape[0], int(worlds.action_space.n), worlds.num_envs
    now, whole = torch.as_tensor(worlds.reset()), torch.as_tensor(worlds.state(per_row=True))
    agent = Agent(inputs, whole.shape[-1], actions)
    optimiser = torch.optim.Adam(agent.parameters(), eps=1e-5)
    seen, state = torch.empty(ROLLOUT, rows, inputs), torch.empty(ROLLOUT, *whole.shape)
    action = torch.empty(ROLLOUT, rows, dtype=torch.int64)
    logp, reward = torch.empty(ROLLOUT, rows), torch.empty(ROLLOUT, rows)
    done, value = torch.empty(ROLLOUT, rows, dtype=torch.bool), torch.empty(ROLLOUT + 1, rows)
    begun, ended, updates = time.time(), [], max(1, o.steps // (ROLLOUT * rows))
    for update in range(updates):
        for t in range(ROLLOUT):
            with torch.no_grad():
                chances = torch.distributions.Categorical(logits=agent.actor(now))
                seen[t], state[t], action[t], value[t] = now, whole, chances.sample(), agent.value(now, whole)
                logp[t] = chances.log_prob(action[t])
            following, gained, last, infos = worlds.step(action[t].numpy())
            reward[t], done[t] = torch.as_tensor(gained), torch.as_tensor(last)
            reward[t] += GAMMA * value[t] * done[t]  # a world that was cut off goes on in truth: its value counts
            ended += [info["world_metrics"] for info in infos if "world_metrics" in info] if last.any() else []
            now, whole = torch.as_tensor(following), torch.as_tensor(worlds.state(per_row=True))
        with torch.no_grad():
            value[-1] = agent.value(now, whole)
        gain = advantages(reward, value, done)
        target = gain + value[:-1]
        agent.mean += 0.1 * (target.mean().item() - agent.mean)
        agent.spread += 0.1 * (max(target.std().item(), 1e-3) - agent.spread)
        optimiser.param_groups[0]["lr"] = o.learning_rate * (1 - update / updates)
        batch = [x.flatten(0, 1) for x in (seen, state, action, logp, gain, target)]
        for _ in range(EPOCHS):
            for chosen in torch.randperm(ROLLOUT * rows).chunk(MINIBATCHES):
                x, s, a, before, g, wanted = (x[chosen] for x in batch)
                chances = torch.distributions.Categorical(logits=agent.actor(x))
                ratio, g = (chances.log_prob(a) - before).exp(), (g - g.mean()) / (g.std() + 1e-8)
                policy = -torch.minimum(ratio * g, ratio.clamp(1 - CLIP, 1 + CLIP) * g).mean()
                error = ((agent.value(x, s) - wanted) / agent.spread).square().mean()
                optimiser.zero_grad()
                (policy + 0.5 * error - ENTROPY * chances.entropy().mean()).backward()
                nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
                optimiser.step()
        if update % 20 == 19 or update + 1 == updates:
            names = "goals_per_robot_hour", "collisions_per_km"
            goals, hits = (np.mean([one[name] for one in ended[-o.worlds :]] or math.nan) for name in names)
            taken = f"{(update + 1) * ROLLOUT * rows:,} agent-steps, {time.time() - begun:.0f} s"
            print(f"{taken}: {goals:.0f} goals per robot-hour, {hits:.1f} collisions/km")
    record = PolicyRecord("mappo", Network(inputs, actions, True, (64, 64)), worlds.get_attr("config", 0)[0])
    actor = {f"actor.{name}": x.numpy() for name, x in agent.actor.state_dict().items()}
    print(f"wrote {save_policy(o.out, record, actor)}")


if __name__ == "__main__":
    run_script(Options, main)
