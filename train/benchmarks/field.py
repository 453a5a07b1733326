"""The protective field held against its promise: contacts per robot-km, under whatever drives, and where the promise
does not reach, with noise in what robots do.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents import make_policy, policy_config
from train.benchmarks.slip import Noise, slip
from train.reporting.report import Table, number
from train.reporting.rows import Row, select
from warehouse_env.config import ActionType, EnvConfig
from warehouse_env.maps.layouts import LAYOUTS, make_layout
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.traffic_spec import TrafficSpec

PLANNER = "astar_turns"
ROBOTS = (8, 32, 128)
EPISODE = 120  # [s], for under the field alone jams only grow, and who stands drives no kilometres
CHANGE = 10  # env steps for which a random command is held on average
BORED = 2.0  # [s] held back after which a hunter lets go
MARGINS = (0.0, 0.01, 0.02, 0.05, 0.1)  # [m], for what they cost
NOISY_DRIVERS = ("ppo", "random", "hunter")
NOISY_MARGINS = (0.0, 0.02, 0.05, 0.1, 0.2, 0.3)
NOISES = {"none": Noise(0.0, 0.0, 0.0), "5%": Noise(0.05, 0.002, 0.002), "20%": Noise(0.2, 0.01, 0.01)}
POLICY = "ppo"

Driver = Callable[[Simulator], NDArray[Any]]
"""The next actions of all robots of a simulator."""


def _learned(name: str, config: EnvConfig, rng: np.random.Generator) -> Driver:
    policy = make_policy(name, config)
    return lambda simulator: policy.act(simulator.observation, rng)


def _random(config: EnvConfig, rng: np.random.Generator) -> Driver:
    """Full commands of either sign, held for a while each."""
    held = np.zeros((1, config.num_agents, 2))

    def act(simulator: Simulator) -> NDArray[Any]:
        nonlocal held
        fresh = rng.choice([-1.0, 0.0, 1.0], held.shape, p=[0.2, 0.2, 0.6])
        held = np.where(rng.random((*held.shape[:2], 1)) < 1 / CHANGE, fresh, held)
        return held

    return act


def _hunt(config: EnvConfig, rng: np.random.Generator) -> Driver:
    """At the nearest robot at full speed; who has been held back for long backs away first, turning at random."""
    backing = np.zeros((1, config.num_agents))  # env steps yet to go, positive or negative by the side turned to

    def act(simulator: Simulator) -> NDArray[Any]:
        nonlocal backing
        robots = simulator.robots
        bored = robots["shield"]["vetoed_time"] > BORED
        backing = np.where(bored, rng.uniform(-40, 40, robots.shape), backing - np.sign(backing))
        backing[np.abs(backing) < 1] = 0.0
        wanted = np.where(backing == 0.0, _towards_nearest(robots), np.sign(backing) * config.robot.max_steering)
        rate = np.clip(
            (wanted - robots["motion"]["steer"]) / (config.time_step * config.robot.max_steering_rate), -1, 1
        )
        return np.stack([np.where(backing == 0.0, 1.0, -1.0), rate], axis=-1)

    return act


def _towards_nearest(robots: NDArray[Any]) -> NDArray[np.float64]:
    """Return the steering angles [B, N] [rad], not yet limited, that turn each robot's nose to its nearest robot."""
    place = robots["motion"]["x"] + 1j * robots["motion"]["y"]
    away = place[:, None, :] - place[:, :, None]
    away[:, np.arange(away.shape[1]), np.arange(away.shape[1])] = np.inf
    nearest = np.take_along_axis(away, np.abs(away).argmin(-1)[..., None], -1)[..., 0]
    return np.asarray(-2.0 * np.angle(nearest * np.exp(-1j * robots["motion"]["heading"].astype(np.float64))))


# name -> action type, maker
DRIVERS: dict[str, tuple[ActionType, Callable[[EnvConfig, np.random.Generator], Driver]]] = {
    "ppo": ("discrete", lambda config, rng: _learned("ppo", config, rng)),
    "reinforce": ("discrete", lambda config, rng: _learned("reinforce", config, rng)),
    "greedy": ("discrete", lambda config, rng: _learned("greedy", config, rng)),  # by right of way, with live routes
    "random": ("continuous", _random),
    "random, raw": ("raw", _random),
    "hunter": ("raw", _hunt),
}


def field(seconds: float, seed: int) -> Iterator[Row]:
    """Yield a row for every layout, number of robots and driver; for every margin; for every noise and margin."""
    for layout in LAYOUTS:
        grid = make_layout(layout)
        for robots in (count for count in ROBOTS if count <= len(grid.picks) + len(grid.stations)):  # of distinct goals
            for name in DRIVERS:
                yield {"part": "promise", **drive(name, _config(name, layout, robots), seconds, seed)}
    for margin in MARGINS:
        config = _with_margin(_config(POLICY, "paper46", 32), margin)
        yield {"part": "margin", **drive(POLICY, config, seconds, seed)}
    for name, noise, margin in itertools.product(NOISY_DRIVERS, NOISES, NOISY_MARGINS):
        config = _with_margin(_config(name, "paper46", 32), margin)
        yield {"part": "noise", **drive(name, config, seconds, seed, noise)}


def _with_margin(config: EnvConfig, margin: float) -> EnvConfig:
    return config.replace(traffic=dataclasses.replace(config.traffic_spec, margin=margin))


def _config(driver: str, layout: str, robots: int) -> EnvConfig:
    action_type, shielded = DRIVERS[driver][0], TrafficSpec(shield=True)
    base = EnvConfig(layout, robots, PLANNER, action_type=action_type, action_repeat=2, traffic=shielded)
    return policy_config(driver, base) if action_type == "discrete" else base


def drive(name: str, config: EnvConfig, seconds: float, seed: int, noise: str = "none") -> Row:
    """Drive a world for `seconds` in episodes of EPISODE, with a noise of NOISES; return what happens."""
    simulator = Simulator(config)
    rng = np.random.default_rng(seed)
    act = DRIVERS[name][1](config, rng)
    interval = config.time_step * config.action_repeat
    totals = {"robot_km": 0.0, "collisions_robot": 0.0, "collisions_shelf": 0.0, "goals": 0.0}
    slips, least, episodes = 0, math.inf, max(1, round(seconds / EPISODE))
    for episode in range(episodes):
        simulator.reset(seed + episode)
        for _ in range(round(EPISODE / interval)):
            before = simulator.robots.copy()
            simulator.step(act(simulator))
            slips += slip(simulator, before, NOISES[noise], rng)
        row = simulator.episode_metrics()
        totals = {key: value + row[key] for key, value in totals.items()}
        least = min(least, row["min_clearance_m"]) if row["min_clearance_m"] == row["min_clearance_m"] else least
    contacts = totals["collisions_robot"] + totals["collisions_shelf"] + slips
    hours = episodes * EPISODE * config.num_agents / 3600
    return {
        "driver": name, "layout": config.layout, "robots": config.num_agents, "margin_m": config.traffic_spec.margin,
        "noise": noise, **totals, "slips": slips, "contacts_per_km": contacts / totals["robot_km"],
        "min_clearance_m": least, "goals_per_robot_hour": totals["goals"] / hours,
    }  # fmt: skip


def field_tables(rows: list[Row]) -> list[Table]:
    """Return the tables of `field`'s rows."""
    return [table for table in (_promise(rows), _margins(rows), _noises(rows)) if table.cells]


def _promise(rows: list[Row]) -> Table:
    header = ("layout", "robots", *DRIVERS)
    kept = select(rows, part="promise")
    places = dict.fromkeys((row["layout"], row["robots"]) for row in kept)
    cells = tuple(
        (layout, str(robots), *(_contacts(select(kept, layout=layout, robots=robots, driver=name)) for name in DRIVERS))
        for layout, robots in places
    )
    km, found = sum(row["robot_km"] for row in kept), sum(_found(row) for row in kept)
    return Table("Contacts in robot-km under the field", header, cells, f"{found:.0f} contacts in {km:,.1f} robot-km.")


def _found(row: Row) -> float:
    return float(row["collisions_robot"] + row["collisions_shelf"] + row["slips"])


def _contacts(rows: list[Row]) -> str:
    return f"{sum(map(_found, rows)):.0f} in {sum(row['robot_km'] for row in rows):.1f}" if rows else ""


def _margins(rows: list[Row]) -> Table:
    cells = tuple(
        (number(row["margin_m"], 2), number(row["goals_per_robot_hour"]), _contacts([row]))
        for row in select(rows, part="margin")
    )
    return Table(f"What the margin costs {POLICY}", ("margin [m]", "goals/robot-h", "contacts in robot-km"), cells)


def _noises(rows: list[Row]) -> Table:
    kept = select(rows, part="noise")
    kinds = dict.fromkeys((row["driver"], row["noise"]) for row in kept)
    cells = tuple((driver, noise, *map(_a_km, select(kept, driver=driver, noise=noise))) for driver, noise in kinds)
    sizes = (f"{name} {100 * one.command:g}%, {one.slip:g} m, {one.turn:g} rad" for name, one in NOISES.items())
    note = (
        "Robots + shelves, from which the field keeps no margin. Noise of acceleration and steering rate, and of place "
        f"and heading per metre driven: {'; '.join(sizes)}"
    )
    header = ("driver", "noise", *(f"margin {margin:g} m" for margin in NOISY_MARGINS))
    return Table("Contacts per robot-km with noise", header, cells, note)


def _a_km(row: Row) -> str:
    robots, shelves = row["collisions_robot"] + row["slips"], row["collisions_shelf"]
    return f"{number(robots / row['robot_km'], 2)} + {number(shelves / row['robot_km'], 2)}"
