"""PPO whose policy reads its neighbours, any number of them, as a set, by attention: `python examples/attention.py`.

In its own worlds it reaches 53 goals per robot-hour at 7.9 collisions/km after 0.18 million agent-steps and 135 at 1.0
after 1.5 million (131 s of one core), as `cleanrl_ppo.py` does. `warehouse evaluate --policy FILE:Attending` drives it.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from safetensors.torch import load_model, save_model
from torch import nn

import warehouse_env
from train.cli import run_script
from warehouse_env import LEARNING, observation_layout
from warehouse_env.checked import Checked
from warehouse_env.observation import NEIGHBOUR

WEIGHTS = Path("runs/attention.safetensors")
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
    neighbours: int = 6
    """Nearest robots that a robot observes; the trained policy takes any number."""
    steps: int = 1_500_000
    """Agent-steps (decisions of one robot)."""
    learning_rate: float = 1e-3
    """Step size of Adam at the start; it falls linearly to 0."""
    seed: int = 0
    """Seed of worlds, networks and actions."""
    out: Path = WEIGHTS
    """File of the weights."""


class Agent(nn.Module):
    """An encoder of the own state, attention over the neighbours, and the heads of actor and critic."""

    def __init__(self, config: warehouse_env.EnvConfig) -> None:
        super().__init__()
        layout, actions = observation_layout(config), len(config.speed_levels) * len(config.lateral_offsets)
        self.part = layout.slices["neighbours"]
        self.own = nn.Linear(layout.size - (self.part.stop - self.part.start), 64)
        self.other = nn.Linear(NEIGHBOUR, 64)
        self.query, self.key, self.value = (nn.Linear(64, 64, bias=False) for _ in range(3))
        self.both, self.actor, self.critic = nn.Linear(128, 64), nn.Linear(64, actions), nn.Linear(64, 1)
        nn.init.orthogonal_(self.actor.weight, 0.01)

    def forward(self, seen: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return logits [rows, A] and values [rows] from observations [rows, inputs]."""
        own = torch.tanh(self.own(torch.cat((seen[:, : self.part.start], seen[:, self.part.stop :]), -1)))
        others = seen[:, self.part].unflatten(-1, (-1, NEIGHBOUR))  # [rows, K, 7]; all 0 where nobody is
        codes = torch.tanh(self.other(others))
        scores = (self.key(codes) * self.query(own).unsqueeze(1)).sum(-1) / 8.0
        weights = scores.masked_fill(others[..., -1] == 0, -1e9).softmax(-1) * (others[..., -1] != 0)
        heard = (weights.unsqueeze(-1) * self.value(codes)).sum(1)
        code = torch.tanh(self.both(torch.cat((own, heard), -1)))
        return self.actor(code), self.critic(code).squeeze(-1)


class Attending:
    """The trained policy, for commands."""

    needs = {name: getattr(LEARNING, name) for name in ("traffic", "sensor", "action_repeat")}  # noqa: RUF012

    def __init__(self, config: warehouse_env.EnvConfig, weights: Path = WEIGHTS) -> None:
        self.agent = Agent(config)
        load_model(self.agent, weights)

    @torch.no_grad()
    def act(self, observation: Any, rng: np.random.Generator) -> Any:
        """Draw an action for each robot."""
        logits, shape = self.agent(torch.as_tensor(observation).flatten(0, 1))[0], observation.shape[:2]
        return (logits + torch.as_tensor(rng.gumbel(size=logits.shape))).argmax(-1).numpy().reshape(shape)


def main(o: Options) -> None:
    """Train, print a line every twenty updates, and save the weights."""
    torch.set_num_threads(1)  # the simulator has its own threads; torch's would slow both down
    torch.manual_seed(o.seed)
    sensor = replace(LEARNING.sensor, neighbours=o.neighbours)
    worlds = warehouse_env.vec_env(o.worlds, LEARNING, num_agents=o.robots, sensor=sensor)
    worlds.seed(o.seed)
    inputs, rows = worlds.observation_space.shape[0], worlds.num_envs
    agent = Agent(worlds.get_attr("config", 0)[0])
    optimiser = torch.optim.Adam(agent.parameters(), eps=1e-5)
    seen, action = torch.empty(ROLLOUT, rows, inputs), torch.empty(ROLLOUT, rows, dtype=torch.int64)
    logp, reward, value, gain, goes_on = (torch.empty(ROLLOUT, rows) for _ in range(5))
    now, ended, begun = torch.as_tensor(worlds.reset()), [], time.time()
    updates = max(1, o.steps // (ROLLOUT * rows))
    for update in range(updates):
        for t in range(ROLLOUT):
            with torch.no_grad():
                logits, value[t] = agent(now)
            chances = torch.distributions.Categorical(logits=logits)
            seen[t], action[t] = now, chances.sample()
            logp[t] = chances.log_prob(action[t])
            following, gained, last, infos = worlds.step(action[t].numpy())
            goes_on[t] = torch.as_tensor(~last)
            # a world that was cut off goes on in truth: its last value stands for the next
            reward[t] = torch.as_tensor(gained) + GAMMA * value[t] * (1 - goes_on[t])
            ended += [info["world_metrics"] for info in infos if "world_metrics" in info] if last.any() else []
            now = torch.as_tensor(following)
        with torch.no_grad():
            after, ahead = agent(now)[1], torch.zeros(rows)
        for t in reversed(range(ROLLOUT)):
            ahead = reward[t] + GAMMA * goes_on[t] * (after + LAMBDA * ahead) - value[t]
            gain[t], after = ahead, value[t]
        optimiser.param_groups[0]["lr"] = o.learning_rate * (1 - update / updates)
        batch = [x.flatten(0, 1) for x in (seen, action, logp, gain, gain + value)]
        for _ in range(EPOCHS):
            for chosen in torch.randperm(ROLLOUT * rows).chunk(MINIBATCHES):
                x, a, before, g, target = (x[chosen] for x in batch)
                logits, guess = agent(x)
                chances = torch.distributions.Categorical(logits=logits)
                ratio, g = (chances.log_prob(a) - before).exp(), (g - g.mean()) / (g.std() + 1e-8)
                policy = -torch.minimum(ratio * g, ratio.clamp(1 - CLIP, 1 + CLIP) * g).mean()
                optimiser.zero_grad()
                (policy + 0.5 * (guess - target).square().mean() - ENTROPY * chances.entropy().mean()).backward()
                nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
                optimiser.step()
        if update % 20 == 19 or update + 1 == updates:
            names = "goals_per_robot_hour", "collisions_per_km"
            goals, hits = (np.mean([one[name] for one in ended[-o.worlds :]] or math.nan) for name in names)
            taken = f"{(update + 1) * ROLLOUT * rows:,} agent-steps, {time.time() - begun:.0f} s"
            print(f"{taken}: {goals:.0f} goals per robot-hour, {hits:.1f} collisions/km")
    o.out.parent.mkdir(parents=True, exist_ok=True)
    save_model(agent, o.out)
    print(f"wrote {o.out}")


if __name__ == "__main__":
    run_script(Options, main)
