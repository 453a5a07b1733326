"""Short films of policies that drive, side by side."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Unpack

import numpy as np

from train.books import simulator_of
from train.central import CENTRAL
from train.evaluation.rollout import POLICY_STREAM, Decider, config_of, make_actor
from train.evaluation.scenes import SCENES
from warehouse_env.config import ConfigChanges, EnvConfig
from warehouse_env.errors import ConfigError, unknown_name
from warehouse_env.render.floor import scale_for
from warehouse_env.render.frame import Scene, draw, scene_of
from warehouse_env.render.video import VideoWriter

FPS = 10.0  # frames a second of a film
_LARGEST = 32.0  # [px/m]
_BETWEEN = "   "  # the parts of a caption


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

    The film shows `seconds` [s] from `begin` on, `speed` times as fast as real time; the longest side of a floor is
    `pixels` wide. Options are those of EnvConfig and override what a policy needs. scene: a name of SCENES instead of a
    floor. Raises ConfigError for wrong names and values, WeightsError for an unusable policy folder.
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
    """Yield a scene of a world that a policy drives, one every `every` seconds."""
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
    decide, rng = _decider(policy, config), np.random.default_rng([seed, POLICY_STREAM])
    for frame in range(round(seconds / every) + 1):
        while simulator.seconds(0) < begin + frame * every - 1e-6:
            simulator.step(decide(simulator, [rng]))
        shown = scene_of(simulator)
        yield shown._replace(text=_BETWEEN.join([policy, *shown.text.split(_BETWEEN)[2:]]))  # for floor and robots


def _decider(policy: str, config: EnvConfig) -> Decider:
    """Return the function that chooses the actions of one world, as in an evaluation."""
    if policy in CENTRAL:
        return CENTRAL[policy].make(config).act_on
    act = make_actor(policy, config)
    return lambda simulator, generators: act(simulator.observation, generators[0])
