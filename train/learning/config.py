"""The options of a training: the dataclass is the command line, the record in the checkpoint and on the card.

Each trainer has a dataclass; recipes.py has the defaults that made each policy. Training worlds use seeds below
HELD_OUT_SEED and evaluations the seeds from there on, so no measured episode was trained on.
"""

import dataclasses
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import tyro

from agents.weights_folder import Mode
from train.kinds import Kinds
from train.learning.floors import check_fixed
from warehouse_env.checked import Checked
from warehouse_env.config import ActionType, EnvConfig, RewardWeights, SensorSpec
from warehouse_env.traffic_spec import TrafficSpec, read_traffic, written_traffic

HELD_OUT_SEED = 1_000_000
DRAWN = tuple(f"aisles:seed={seed}" for seed in range(1, 9))  # floors drawn at random, which are trained on
_OLD = {"protective_field", "reroute", "right_of_way_after"}  # names that checkpoints may hold
_MOST_SAMPLES = 100_000_000  # decisions of all rows between two updates; with 112 numbers each they fill 45 GB

_Floors = Annotated[tuple[str, ...], tyro.conf.arg(aliases=("--layout", "--map"))]


@dataclass(frozen=True)
class TrainingConfig(Checked):
    """Options of all trainers: worlds, budget, reward schedule, network and folders."""

    algorithm: ClassVar[str]  # names the trainer in checkpoints and policy folders

    name: str = "policy"
    """Name of the run; its folder is OUT/NAME."""
    recipe: Annotated[str | None, tyro.conf.Suppress] = None
    """The recipe that gave the defaults; None: those of the dataclass."""
    out: Path = Path("runs")
    """Folder that holds the runs."""
    resume: Path | None = None
    """Folder of a run to resume on its own schedule; other options must be left out."""
    seed: int = 0
    """Seed of the networks, the worlds and the sampling."""
    minutes: float | None = None
    """Budget of wall-clock time; with STEPS as well, whichever ends first."""
    steps: int | None = None
    """Budget of agent-steps (one decision of one robot); 45 million without MINUTES."""
    layouts: _Floors = ("paper46", "narrow", "single_lane", *DRAWN[:4])
    """Floors to train on: names of `warehouse layouts`, files NAME.map or NAME.yaml, or your own, FILE.py:FUNCTION;
    each is mixed with each robot count. seed=new, as in aisles:seed=new, draws new floors as the training goes on."""
    robots: tuple[int, ...] = (16, 32)
    """Robots in a world."""
    fleet: Annotated[Kinds | None, tyro.conf.Suppress] = None
    """The kinds of robots; None: all are RobotSpec's default."""
    rows: int = 1056
    """Robots stepped at a time over all worlds, rounded so that every mix has at least one world."""
    planner: str | None = "astar_turns"
    """Planner of the routes in training; None: pf_aco with live routes, else astar_turns."""
    keep_right: float = EnvConfig.keep_right
    """How far routes keep to the right of the planned path where there is room [m]."""
    action_type: ActionType = "discrete"
    """What the policy commands."""
    episode_seconds: float = 200.0
    """Simulated time after which a world is reset [s]."""
    jam_seconds: float = 60.0
    """Reset a world early once a fifth of its robots have stood still for this long [s]."""
    gamma: float = 0.98
    """Discount of one decision."""
    gae_lambda: float = 0.95
    """Weight of longer returns in the advantage; 1 is the plain truncated return minus the baseline."""
    collision_first: float = -1.0
    """Reward of a contact at the start; large penalties there teach robots to park."""
    collision_last: float = -150.0
    """Reward of a contact at the end; it changes linearly with the share of the budget spent."""
    contact: float = -0.5
    """Reward of every decision in contact unless the command is to stand; pushing on must not pay."""
    shared: float = 0.3
    """Share of a robot's reward that is the mean over all robots within 6 m, so that giving way can pay."""
    reward_scale: float = 0.1
    """Factor on all rewards."""
    entropy_first: float = 0.01
    """Weight of the entropy bonus at the start."""
    entropy_last: float = 0.002
    """Weight of the entropy bonus at the end."""
    learning_rate: float = 1.5e-4
    """Adam's first step size; it decays linearly to a twentieth."""
    gradient_clip: float = 0.5
    """Largest norm of a gradient."""
    hidden: tuple[int, ...] = (128, 128)
    """Widths of the hidden tanh layers, of the actor and of the critic."""
    action_repeat: int = 2
    """Physics steps between two decisions in training; the finished policy decides at every step."""
    predictions: bool = True
    """Observe for every action the time to a conflict; the untrained policy then avoids conflicts."""
    tasks: str = "lifelong"
    """Starts and goals in training: lifelong, or by your own sampler, FILE.py:CLASS."""
    sensor: str | None = None
    """Observe also what your own sensor does: FILE.py:CLASS or MODULE:CLASS (docs/how_to/policy.md)."""
    traffic: str = "routes"
    """How robots meet when the finished policy drives: none, routes, shield, rules or assist, with switches of
    TrafficSpec behind it, as in assist:right_of_way_after=6. The training itself has no right of way, which is quicker
    and made no measurable difference, and replans only barred routes, which takes half the time."""
    cruise_bias: float = 1.5
    """Without predictions: how strongly the untrained policy prefers to cruise on its route (logits)."""
    rollout: int = 24
    """Decisions of every robot between two updates."""
    minibatch: int = 4096
    """Rows of one gradient step."""
    checkpoint_seconds: float = 60.0
    """Time between checkpoints [s]."""
    evaluation_seconds: float = 120.0
    """Least time between two evaluations on held-out seeds [s]; they take at most 3% of the processor time. 0: none.
    They do not change what is learned."""
    threads: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Threads of torch and of the simulator."""
    progress: bool = True
    """Show the progress bar; otherwise, or without a terminal, print a line every minute."""
    retired: ClassVar[dict[str, Any]] = {"caution": 1.0}
    ranges: ClassVar = {
        "steps": (1, 10**15), "rows": (1, 10**7), "robots": (1, 10**7), "action_repeat": (1, 10**7),
        "threads": (1, 1024), "seed": (0, 2**32 - 1), "hidden": (1, 16_384), "minibatch": (1, _MOST_SAMPLES),
        "minutes": (1e-9, 1e9), "episode_seconds": (1e-9, 1e9), "jam_seconds": (1e-9, 1e9),
        "checkpoint_seconds": (0.0, 1e9), "evaluation_seconds": (0.0, 1e9), "entropy_first": (0.0, 1e9),
        "entropy_last": (0.0, 1e9), "cruise_bias": (0.0, 1e9), "keep_right": (0.0, 1e9),
        "reward_scale": (1e-30, 1e9), "learning_rate": (1e-30, 1e9), "gradient_clip": (1e-30, 1e9),
        "gamma": (0.0, 1.0), "gae_lambda": (0.0, 1.0), "shared": (0.0, 1.0), "collision_first": (-1e9, 1e9),
        "collision_last": (-1e9, 1e9), "contact": (-1e9, 1e9),
    }  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "traffic", written_traffic(self.traffic_spec))
        self._between(1, _MOST_SAMPLES // self.rows, "rollout")
        self._require(self.tasks != "one_shot", "tasks", "lifelong, or your own sampler of lifelong tasks")
        for name, most in (("layouts", 100), ("robots", 100), ("hidden", 16)):
            self._require(1 <= len(getattr(self, name)) <= most, name, f"1 to {most} values")
        for robots in self.robots:
            EnvConfig(num_agents=robots, **self.kinds_of(robots))  # raises before anything is made
        plain = Path(self.name).name == self.name not in ("", "..")
        self._require(plain, "name", "a plain folder name; the folder around it is --out")

    @property
    def directory(self) -> Path:
        """Folder of the run: the policy itself, its card, checkpoint/ and tensorboard/."""
        return self.resume if self.resume is not None else self.out / self.name

    @property
    def total_steps(self) -> int | None:
        """Budget of agent-steps; None if only time limits the run."""
        return 45_000_000 if self.steps is None and self.minutes is None else self.steps

    @property
    def traffic_spec(self) -> TrafficSpec:
        """The single switches of `traffic`."""
        return read_traffic(self.traffic)

    @property
    def router(self) -> str:
        """Name of the planner of the routes."""
        return self.planner or ("pf_aco" if self.traffic_spec.routes else "astar_turns")

    def worlds(self, rows: float) -> list[tuple[EnvConfig, int]]:
        """Return an (environment, number of worlds) for every layout and robot count, `rows` robots in all."""
        mixes = [(layout, robots) for layout in self.layouts for robots in self.robots]
        share = rows / len(mixes)
        return [(self.env(layout, robots), max(1, round(share / robots))) for layout, robots in mixes]

    def kinds_of(self, robots: int) -> dict[str, Any]:
        """Return the fields of EnvConfig for the kinds of `robots` robots."""
        return {} if self.fleet is None else self.fleet.of(robots)

    def env(self, layout: str, robots: int) -> EnvConfig:
        """Return the environment of one layout or map file and robot count."""
        spec = self.traffic_spec
        routes: Literal[False, "barred"] = "barred" if spec.routes else False
        env = EnvConfig(
            layout=layout, num_agents=robots, planner=self.router, tasks=self.tasks, keep_right=self.keep_right,
            action_repeat=self.action_repeat, sensor=SensorSpec(predictions=self.predictions, extra=self.sensor),
            traffic=dataclasses.replace(spec, right_of_way=False, right_of_way_after=0.0, routes=routes),
            **self.kinds_of(robots),
        )  # fmt: skip
        decision = env.time_step * env.action_repeat
        steps = max(1, round(self.episode_seconds / decision))
        return env.replace(action_type=self.action_type, max_steps=steps, reward=self.reward(0.0))

    def driven(self, env: EnvConfig) -> EnvConfig:
        """Return an environment of the training as the policy is driven in: all robots replan, and it decides at every
        physics step, which brought 1 to 6% more goals on trial seeds, or half of the contacts.
        """
        steps, traffic = env.max_steps * env.action_repeat, self.traffic_spec
        return env.replace(action_repeat=1, max_steps=steps, traffic=traffic, quick_searches=False)

    @property
    def mode(self) -> Mode:
        """How actions are chosen: sampled, so that two equal robots do not wait for each other; or, with right of way,
        the best (1 to 3% more goals on trial seeds).
        """
        return "greedy" if self.traffic_spec.right_of_way else "sample"

    def reward(self, spent: float) -> RewardWeights:
        """Return the reward weights when the share `spent` (0 to 1) of the budget is used."""
        collision = self.collision_first + (self.collision_last - self.collision_first) * spent
        return RewardWeights(collision=collision, contact=self.contact)

    def entropy(self, spent: float) -> float:
        """Return the weight of the entropy bonus when the share `spent` (0 to 1) of the budget is used."""
        return self.entropy_first + (self.entropy_last - self.entropy_first) * spent

    def step_size(self, spent: float) -> float:
        """Return Adam's step size when the share `spent` (0 to 1) of the budget is used."""
        return self.learning_rate * (1.0 - 0.95 * spent)

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON types, for the checkpoint and the card."""
        return {
            key: str(value) if isinstance(value, Path) else value for key, value in dataclasses.asdict(self).items()
        }

    @classmethod
    def upgraded(cls, data: dict[str, Any]) -> dict[str, Any]:
        """Return stored options by today's names."""
        if "traffic" in data or not _OLD & data.keys():
            return data
        usual = cls().traffic_spec
        after = data.get("right_of_way_after", usual.right_of_way_after if usual.right_of_way else None)
        old: dict[str, Any] = {"protective_field": bool(usual.shield), "reroute": bool(usual.routes)}
        old |= {name: data[name] for name in _OLD & data.keys()}
        old |= {"right_of_way": after is not None, "right_of_way_after": after or 0.0}
        text = written_traffic(EnvConfig.from_dict(old).traffic_spec)
        return {name: value for name, value in data.items() if name not in _OLD} | {"traffic": text}


@dataclass(frozen=True)
class ThreadedConfig(TrainingConfig):
    """Options of the trainers whose threads have worlds of their own (threaded.py)."""

    critic_factor: float = 4.0
    """The critic's step size, as a multiple of the actor's."""
    floor_episodes: int = 2
    """Episodes on a floor that seed=new drew, until it draws the next."""
    late_braking: float = 0.0
    """Reward of a metre driven from where even braking is predicted to touch within 0.6 s: contacts alone are rare."""
    start: str | None = None
    """Policy to begin with instead of an untrained one: a name or a run's folder."""
    device: str | None = None
    """Keep worlds, rollouts and updates on a device: cuda, cuda:1, or cpu, which needs no GPU (docs/how_to/gpu.md)."""
    ranges: ClassVar = {"critic_factor": (0.0, 1e9), "floor_episodes": (1, 1_000_000), "late_braking": (-1e9, 0.0)}

    def env(self, layout: str, robots: int) -> EnvConfig:
        """Return the environment of one layout or map file and robot count."""
        return super().env(layout, robots).replace(quick_searches=self.device is not None)

    def __post_init__(self) -> None:
        super().__post_init__()
        predicts = self.predictions and 0.0 in self.env("open", self.robots[0]).speed_levels
        self._require(predicts or self.late_braking == 0.0, "late_braking", "0 without predictions")
        if self.device is not None:
            from warehouse_env.simulation.device.memory import memory_of
            from warehouse_env.simulation.device.simulator import check_device

            check_fixed(self.layouts)
            memory_of(self.device)
            check_device(self.env("open", self.robots[0]))


@dataclass(frozen=True)
class ClippedConfig(TrainingConfig):
    """Options of both PPOs."""

    epochs: int = 2
    """Passes over the rows of one rollout."""
    clip: float = 0.2
    """How far the probability ratio may leave 1."""
    ranges: ClassVar = {"epochs": (1, _MOST_SAMPLES)}

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require(0 < self.clip < 1, "clip", "between 0 and 1")


@dataclass(frozen=True)
class ReinforceConfig(ThreadedConfig):
    """Train our policy gradient: REINFORCE over the next action command, with a learned value as baseline."""

    algorithm = "reinforce (ours)"
    minibatch: int = 2048


@dataclass(frozen=True)
class ThreadedPPOConfig(ThreadedConfig, ClippedConfig):
    """Train our own proximal policy optimisation (PPO), in threads."""

    algorithm = "ppo (ours)"
    collision_last: float = -30.0
    traffic: str = "assist"
    learning_rate: float = 5e-4
    epochs: int = 3


@dataclass(frozen=True)
class PPOConfig(ClippedConfig):
    """Train proximal policy optimisation (PPO) of stable-baselines3."""

    algorithm = "ppo (stable-baselines3)"
    learning_rate: float = 2e-4

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fixed(self.layouts)
