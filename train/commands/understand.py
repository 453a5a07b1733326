"""`warehouse understand`: what policies are likely to do in telling moments -> rows, and pictures on the floor."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from train.commands.evaluate import Drive
from train.evaluation import telling
from train.evaluation.pictures import file_name
from train.evaluation.rollout import config_of, make_experiment
from train.evaluation.scenes import SCENES
from train.evaluation.telling import MOMENTS, Asked
from train.learning.curves import read_run
from train.reporting.report import make_progress, require_charts
from train.reporting.rows import Row, RowFile, instead
from warehouse_env import __version__
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.files import check_writable
from warehouse_env.planning import make_planner
from warehouse_env.render import probability_maps as pictures
from warehouse_env.render.overview import overview


@dataclass(frozen=True)
class Understand(Drive):
    """Draw what trained policies are likely to do: head-on, on a crossing, beside a robot that sets off, in a jam."""

    policy: tuple[str, ...] = ("ppo", "reinforce")
    """Policies to ask: trained ones, named as for `warehouse evaluate`."""
    runs: tuple[Path, ...] = ()
    """Runs of training whose learning curves stand at the foot of the overviews."""
    seconds: float = 120.0
    """Simulated time within which all robots of a jam must have arrived [s]."""
    json: Path | None = None
    """File for the chances, a row a place or robot, as JSON lines (OUT/rows.jsonl if left out)."""
    overwrite: bool = False
    """Replace the rows that the file holds already."""
    out: Path = Path("results/understand")
    """Folder for the rows and the pictures."""

    def run(self) -> None:
        """Ask every policy, write the rows, a picture of each moment, and an overview of each policy."""
        if not self.policy:
            raise ConfigError("--policy needs at least one value")
        make_planner(self.planner)
        policies = list(dict.fromkeys(self.policy))
        for policy in policies:  # finds what is wrong before the start
            make_experiment(policy, self._base(), 1, self.seconds, self.seed, self.chosen())
            Asked(policy, self._config(policy))
        curves = [read_run(folder).curve for folder in dict.fromkeys(self.runs)]
        check_writable(self.out / "overview.png")
        require_charts()
        kept = RowFile(self.json or self.out / "rows.jsonl", instead=instead(self.overwrite, resumes=False))
        with kept as file, make_progress() as progress:
            bar = progress.add_task("", total=len(policies) * (len(MOMENTS) + len(SCENES)))
            for policy in policies:
                progress.update(bar, description=policy)
                tick = lambda: progress.advance(bar)  # noqa: E731
                maps, jams = self._maps(policy, file, tick), self._jam(policy, file, tick)
                overview(
                    maps, jams, curves, f"What {Path(policy).name} is likely to do", self._path("overview", policy)
                )
        print(f"wrote {file.count:,} rows to {file.path} and the pictures to {self.out}")

    def _base(self) -> EnvConfig:
        return EnvConfig(planner=self.planner, tasks="one_shot")

    def _config(self, policy: str) -> EnvConfig:
        return config_of(policy, self._base(), self.chosen())

    def _path(self, picture: str, policy: str) -> Path:
        return self.out / f"{picture}_{file_name(policy)}.png"

    def _add(self, file: RowFile, scene: str, policy: str, rows: Iterable[Row]) -> None:
        about = {"scene": scene, "policy": policy, "planner": self.planner, "seed": self.seed, "version": __version__}
        file.add(about | row for row in rows)

    def _maps(self, policy: str, file: RowFile, tick: Callable[[], None]) -> dict[str, pictures.ProbabilityMap]:
        """Ask a policy in every telling moment and draw it; return the maps by the moments' titles."""
        maps = {}
        for name, make in MOMENTS.items():
            moment = make()
            one = maps[moment.title] = telling.map_of(moment, policy, self._config(policy))
            self._add(file, name, policy, telling.rows_of_map(one))
            title = f"{moment.title}: chances of {Path(policy).name}, by where its front axle is"
            pictures.probability_maps(one, title, self._path(name, policy))
            tick()
        return maps

    def _jam(self, policy: str, file: RowFile, tick: Callable[[], None]) -> dict[str, pictures.Moments]:
        """Find a policy's worst jam that dissolves and draw it; return it by its title, nothing if there is none."""
        found = telling.worst_jam(policy, self._base(), self.seconds, self.seed, tick, self.chosen())
        if found is None:
            print(f"no jam: under {policy} all robots arrive within {self.seconds:g} s in no scene")
            return {}
        name, film = found
        one = telling.moments_of(film, self._config(policy))
        self._add(file, name, policy, telling.rows_of_film(film))
        title = f"A jam that dissolves: {name}"
        pictures.moments(one, f"{title}, chances of {Path(policy).name} to drive on", self._path("jam", policy))
        return {title: one}
