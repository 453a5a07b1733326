"""Floors drawn anew while a policy trains: those of a layout with `seed=new`, as in "aisles:seed=new"."""

import re
from collections.abc import Iterable, Sequence

import numpy as np

from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError

HELD_OUT_FLOORS = 900_000_000  # seeds from here on are for the evaluations during a training
_FIRST = 1_000_000  # seed of a floor to train on; smaller ones are for tests, choices and reports
_ROBOTS = 64  # on a floor, about: simulators of fewer take longer
_NEW = re.compile(r"(?<=[:,])seed=new(?=,|$)")


def draws_floors(layout: str) -> bool:
    """Tell whether a layout names a new floor each time."""
    return bool(_NEW.search(layout))


def floor_of(layout: str, seed: int) -> str:
    """Return the layout with a seed in place of `new`."""
    return _NEW.sub(f"seed={seed}", layout)


def check_fixed(layouts: Iterable[str]) -> None:
    """Raise ConfigError if a layout draws floors."""
    for layout in filter(draws_floors, layouts):
        fixed = floor_of(layout, 1)
        raise ConfigError(f"{layout} is only for our own trainers on the CPU: choose seeds, as in {fixed}")


class FloorSchedule:
    """Tells the floor of each simulator of a training, from the number of steps alone.

    mixes: (environment, number of worlds) of each simulator; a layout with `seed=new` has one for each floor. drawn:
    number of each of the latter -> steps by which its floors end earlier, so that they end in turn. steps: of the
    training so far.
    """

    def __init__(self, mixes: Iterable[tuple[EnvConfig, int]], seed: Sequence[int], episodes: int) -> None:
        """seed: of the floors drawn. episodes: of max_steps, on each of these."""
        self.mixes, self.steps, self._seed = list[tuple[EnvConfig, int]](), 0, seed
        for env, worlds in mixes:
            floors = max(1, min(worlds, worlds * env.num_agents // _ROBOTS)) if draws_floors(env.layout) else 1
            self.mixes += [(env, len(share)) for share in np.array_split(np.arange(worlds), floors)]
        self._lasts = episodes * self.mixes[0][0].max_steps
        drawn = [number for number, (env, _) in enumerate(self.mixes) if draws_floors(env.layout)]
        self.drawn = {number: self._lasts * turn // len(drawn) for turn, number in enumerate(drawn)}

    def ends(self, number: int) -> bool:
        """Tell whether a simulator's floor ends with the last step."""
        return number in self.drawn and (self.steps + self.drawn[number]) % self._lasts == 0

    def env(self, number: int) -> EnvConfig:
        """Return the environment of a simulator on its present floor."""
        env = self.mixes[number][0]
        entropy = [*self._seed, number, (self.steps + self.drawn.get(number, 0)) // self._lasts]
        drawn = int(np.random.SeedSequence(entropy).generate_state(1)[0])
        return env.replace(layout=floor_of(env.layout, _FIRST + drawn % (HELD_OUT_FLOORS - _FIRST)))
