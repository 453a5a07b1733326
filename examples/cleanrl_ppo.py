"""PPO in one file of plain PyTorch, in the style of CleanRL: `python examples/cleanrl_ppo.py`.

All robots share one policy: a row of `vec_env` is a robot, and PPO sees rows only. The policy is saved as a folder that
every command takes: `warehouse evaluate --policy runs/cleanrl_ppo greedy --robots 16`.

Its own worlds, with `--steps 1_500_000`: 53 goals per robot-hour and 5.9 collisions/km after 0.18 million agent-steps,
136 and 1.0 after 1.1 million (five minutes on busy cores), 137 and 0.6 after 1.5 million.
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
    out: Path = Path("runs/cleanrl_ppo")
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
        for number, layer in enumerate(self, 1):
            x = layer(x) if number == len(self) else torch.tanh(layer(x))
        return x


class Agent(nn.Module):
    """An actor and a critic; `state_dict` names their tensors as `save_policy` wants them."""

    def __init__(self, inputs: int, actions: int) -> None:
        super().__init__()
        self.actor = MLP(inputs, 64, 64, actions, last_gain=0.01)
        self.critic = MLP(inputs, 64, 64, 1, last_gain=1.0)


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
    agent = Agent(inputs, actions)
    optimiser = torch.optim.Adam(agent.parameters(), eps=1e-5)
    seen, action = torch.empty(ROLLOUT, rows, inputs), torch.empty(ROLLOUT, rows, dtype=torch.int64)
    logp, reward = torch.empty(ROLLOUT, rows), torch.empty(ROLLOUT, rows)
    done, value = torch.empty(ROLLOUT, rows, dtype=torch.bool), torch.empty(ROLLOUT + 1, rows)
    now, begun, ended = torch.as_tensor(worlds.reset()), time.time(), []
    updates = max(1, o.steps // (ROLLOUT * rows))
    for update in range(updates):
        for t in range(ROLLOUT):
            with torch.no_grad():
                chances = torch.distributions.Categorical(logits=agent.actor(now))
                seen[t], action[t], value[t] = now, chances.sample(), agent.critic(now).squeeze(-1)
                logp[t] = chances.log_prob(action[t])
            following, gained, last, infos = worlds.step(action[t].numpy())
            reward[t], done[t] = torch.as_tensor(gained), torch.as_tensor(last)
            for row in np.flatnonzero(last):  # a world that was cut off goes on in truth: its value counts
                with torch.no_grad():
                    reward[t, row] += GAMMA * agent.critic(torch.as_tensor(infos[row]["terminal_observation"])).item()
                ended += [infos[row]["world_metrics"]] if "world_metrics" in infos[row] else []
            now = torch.as_tensor(following)
        with torch.no_grad():
            value[-1] = agent.critic(now).squeeze(-1)
        gain = advantages(reward, value, done)
        target = gain + value[:-1]
        optimiser.param_groups[0]["lr"] = o.learning_rate * (1 - update / updates)
        batch = [x.flatten(0, 1) for x in (seen, action, logp, gain, target)]
        for _ in range(EPOCHS):
            for chosen in torch.randperm(ROLLOUT * rows).chunk(MINIBATCHES):
                x, a, before, g, wanted = (x[chosen] for x in batch)
                chances = torch.distributions.Categorical(logits=agent.actor(x))
                ratio, g = (chances.log_prob(a) - before).exp(), (g - g.mean()) / (g.std() + 1e-8)
                policy = -torch.minimum(ratio * g, ratio.clamp(1 - CLIP, 1 + CLIP) * g).mean()
                error = (agent.critic(x).squeeze(-1) - wanted).square().mean()
                optimiser.zero_grad()
                (policy + 0.5 * error - ENTROPY * chances.entropy().mean()).backward()
                nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
                optimiser.step()
        if update % 20 == 19 or update + 1 == updates:
            names = "goals_per_robot_hour", "collisions_per_km"
            goals, hits = (np.mean([one[name] for one in ended[-o.worlds :]] or math.nan) for name in names)
            taken = f"{(update + 1) * ROLLOUT * rows:,} agent-steps, {time.time() - begun:.0f} s"
            print(f"{taken}: {goals:.0f} goals per robot-hour, {hits:.1f} collisions/km")
    record = PolicyRecord("cleanrl_ppo", Network(inputs, actions, True, (64, 64)), worlds.get_attr("config", 0)[0])
    print(f"wrote {save_policy(o.out, record, {name: x.numpy() for name, x in agent.state_dict().items()})}")


if __name__ == "__main__":
    run_script(Options, main)
