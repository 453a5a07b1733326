"""Short moving pictures: of policies that drive, side by side, and of a colony of ants that converges."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from agents import make_policy
from train.books import simulator_of
from train.evaluation.rollout import config_of
from train.evaluation.scenes import SCENES
from warehouse_env.config import ConfigChanges, EnvConfig, RobotSpec
from warehouse_env.errors import ConfigError, unknown_name
from warehouse_env.maps.grid_map import Cell, GridMap
from warehouse_env.planning import make_planner
from warehouse_env.planning.ants.colony import Colony, cells_of
from warehouse_env.planning.ants.floor import Floor, Table
from warehouse_env.planning.ants.system import AntSystem
from warehouse_env.planning.ants.walks import Walks
from warehouse_env.render.floor import FLOOR, scale_for
from warehouse_env.render.frame import CAPTION_HEIGHT, Scene, draw, scene_of
from warehouse_env.render.video import VideoWriter

FPS = 10.0  # frames a second of a film
_LARGEST = 32.0  # [px/m]
_BETWEEN = "   "  # the parts of a caption
_BAR = 12  # [px], the height of the scale above a picture of trails
_LEVELS = 8  # of the tint of trails
_TRAIL = np.array((196, 72, 20), dtype=np.float32)
_POLICY_STREAM = 1  # apart from the world's own stream SeedSequence([seed, 0])


def film(
    path: str | os.PathLike[str],
    *policies: str,
    scene: str | None = None,
    begin: float = 0.0,
    seconds: float = 12.0,
    speed: float = 2.0,
    pixels: int = 368,
    seed: int = 0,
    **options: Unpack[ConfigChanges],
) -> None:
    """Drive each policy from the same seed, and film them side by side into a .gif or .mp4 file.

    From `begin` on for `seconds` [s], `speed` times as fast as in life, the longest side of a floor `pixels` [px]. The
    options are those of EnvConfig, over what a policy asks for; `scene` is a name of SCENES, whose robots have one goal
    each, instead of a floor. Raises ConfigError for wrong names and values, WeightsError for an unusable policy folder.
    """
    if not policies:
        raise ConfigError("name at least one policy to film")
    films = [_driven(policy, scene, seed, begin, seconds, speed / FPS, options) for policy in policies]
    with VideoWriter(path, FPS) as video:
        for scenes in zip(*films, strict=True):
            scale = scale_for(scenes[0].grid, pixels, most=_LARGEST)
            video.add(np.concatenate([draw(one, scale) for one in scenes], axis=1))


def _driven(
    policy: str, scene: str | None, seed: int, begin: float, seconds: float, every: float, options: ConfigChanges
) -> Iterator[Scene]:
    """Yield what is to be seen every so many seconds of a world that a policy drives."""
    if scene is not None and scene not in SCENES:
        raise unknown_name("scene", scene, SCENES)
    played = None if scene is None else SCENES[scene]()
    base = EnvConfig() if played is None else EnvConfig(num_agents=played.robots, tasks="one_shot")
    config = config_of(policy, base, options)
    simulator = simulator_of(config, 1, None if played is None else played.grid)
    if played is None:
        simulator.reset(seed)
    else:
        simulator.reset_to([played.draw(np.random.default_rng([seed, 2]))], [seed])
    made, rng = make_policy(policy, config), np.random.default_rng([seed, _POLICY_STREAM])
    for frame in range(round(seconds / every) + 1):
        while simulator.seconds(0) < begin + frame * every - 1e-6:
            simulator.step(made.act(simulator.observation, rng))
        shown = scene_of(simulator)
        yield shown._replace(text=_BETWEEN.join([policy, *shown.text.split(_BETWEEN)[2:]]))  # for floor and robots


def film_of_ants(
    path: str | os.PathLike[str], planner: str, grid: GridMap, start: Cell, goal: Cell, pixels: int = 368, seed: int = 0
) -> None:
    """Film what a colony knows after each iteration: its pheromone, and the best path so far.

    Raises ConfigError for a planner that is no ant system, PlanError for cells that cannot be used.
    """
    ants = make_planner(planner)
    if not isinstance(ants, AntSystem):
        raise ConfigError(f"planner {planner!r} is no ant system, and leaves no trail")
    known = _iterations(ants, grid, start, goal, seed)
    with VideoWriter(path, FPS) as video:
        for trail, cells in [*known, *known[-1:] * round(FPS)]:  # the last one stays for a second
            video.add(_trail_picture(grid, trail, cells, start, goal, scale_for(grid, pixels, most=_LARGEST)))


def _iterations(
    ants: AntSystem, grid: GridMap, start: Cell, goal: Cell, seed: int
) -> list[tuple[NDArray[np.float64], NDArray[np.int64]]]:
    """Return after each iteration the pheromone of all ways out of a cell float64[H, W], and the best path's cells."""
    known: list[tuple[NDArray[np.float64], NDArray[np.int64]]] = []

    class Watched(type(ants)):  # type: ignore[misc]  # the same system, which tells what it knows
        def colony(self, grid: GridMap, floor: Floor, start: int) -> Colony:
            made: Colony = super().colony(grid, floor, start)

            def update(iteration: int, pheromone: Table, walks: Walks, best: Walks) -> None:
                made.update(iteration, pheromone, walks, best)
                known.append((pheromone.sum(axis=1).reshape(grid.shape), cells_of(floor, best, 0)))

            return replace(made, update=update)

    parameters = {name: value for name, value in vars(ants).items() if not name.startswith("_")}
    Watched(**parameters).search(grid, start, goal, np.random.default_rng(seed))
    return known


def _trail_picture(
    grid: GridMap, trail: NDArray[np.float64], cells: NDArray[np.int64], start: Cell, goal: Cell, scale: float
) -> NDArray[np.uint8]:
    """Draw the floor, the root of the pheromone on it with a scale above, and the best path from start to goal."""
    line = grid.centre(cells).astype(np.float32).reshape(-1, 2)
    pose = np.zeros((1, 3), dtype=np.float32)
    pose[0, :2] = grid.centre(np.array(start))
    none, all_ = np.zeros(1, dtype=np.bool_), np.ones(1, dtype=np.bool_)
    picture = draw(Scene(grid, RobotSpec(), pose, np.array([goal]), [line], none, all_, 0.0, ""), scale)
    picture = picture[:-CAPTION_HEIGHT]
    rows = (np.arange(len(picture)) / scale / grid.cell_size).astype(int).clip(max=grid.shape[0] - 1)
    columns = (np.arange(picture.shape[1]) / scale / grid.cell_size).astype(int).clip(max=grid.shape[1] - 1)
    marked = np.where(grid.occupied, 0.0, np.sqrt(trail / trail.max()))[rows][:, columns]
    bar = np.broadcast_to(np.linspace(0.0, 1.0, picture.shape[1]), (_BAR, picture.shape[1]))
    levels = np.round(np.concatenate([bar, marked])[..., None] * _LEVELS) / _LEVELS  # which a .gif has colours for
    cover = 0.75 * levels.astype(np.float32)
    ground = np.concatenate([np.full((_BAR, *picture.shape[1:]), FLOOR, dtype=np.uint8), picture])
    return np.asarray((ground * (1 - cover) + _TRAIL * cover).round(), dtype=np.uint8)
