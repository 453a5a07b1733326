"""Short films of policies that drive, side by side."""

import itertools
import os
from collections.abc import Iterator, Sequence
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from train.books import simulator_of
from train.evaluation.rollout import POLICY_STREAM, Experiment, decider, make_experiment
from warehouse_env.config import ConfigChanges, EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.maps.fitting import load_floor
from warehouse_env.render.floor import scale_for
from warehouse_env.render.frame import Scene, draw, scene_of
from warehouse_env.render.video import VideoWriter

FPS = 10.0  # frames a second of a film
_LARGEST = 32.0  # [px/m]
_BETWEEN = "   "  # the parts of a caption


def film(
    path: str | os.PathLike[str], *policies: str, begin: float = 0.0, seconds: float = 12.0, speed: float = 2.0,
    pixels: int = 368, seed: int = 0, **options: Unpack[ConfigChanges]
) -> None:  # fmt: skip
    """Drive each policy from the same seed, and film them side by side into a .gif or .mp4 file.

    The film shows `seconds` [s] from `begin` on, `speed` times as fast as real time; the longest side of a floor is
    `pixels` wide. Options are those of EnvConfig and override what a policy needs. Raises ConfigError for wrong names
    and values, WeightsError for an unusable policy folder.
    """
    if not policies:
        raise ConfigError("name at least one policy to film")
    driven = [make_experiment(policy, EnvConfig(), 1, begin + seconds, seed, options) for policy in policies]
    times = [begin + frame * speed / FPS for frame in range(round(seconds * FPS / speed) + 1)]
    scale = scale_for(load_floor(driven[0].config), pixels, most=_LARGEST)
    with VideoWriter(path, FPS) as video:
        for frame in side_by_side([_scenes(experiment, times) for experiment in driven], scale):
            video.add(frame)


def side_by_side(films: Sequence[Iterator[Scene]], scale: float) -> Iterator[NDArray[np.uint8]]:
    """Yield pictures uint8[H, W, 3] of films [px/m] beside each other; a finished one shows its last scene."""
    last: list[NDArray[np.uint8]] = [np.empty((0, 0, 3), np.uint8)] * len(films)
    for scenes in itertools.zip_longest(*films):
        last = [old if scene is None else draw(scene, scale) for scene, old in zip(scenes, last, strict=True)]
        height = max(map(len, last))
        yield np.concatenate([np.pad(one, ((0, height - len(one)), (0, 0), (0, 0))) for one in last], axis=1)


def _scenes(experiment: Experiment, times: list[float]) -> Iterator[Scene]:
    """Drive as an evaluation does, and yield a scene at each of the times [s]."""
    simulator = simulator_of(experiment.config, 1)
    simulator.reset(experiment.seed)
    decide, rng = decider(experiment), np.random.default_rng([experiment.seed, POLICY_STREAM])
    for time in times:
        while simulator.seconds(0) < time - 1e-6:
            simulator.step(decide(simulator, [rng]))
        shown = scene_of(simulator)  # whose caption begins with floor and robots
        yield shown._replace(text=_BETWEEN.join([experiment.driver, *shown.text.split(_BETWEEN)[2:]]))
