"""`warehouse live`: a running simulation, shown and steered on a page in the browser."""

import threading
import webbrowser
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, ClassVar

from agents import POLICIES
from train.commands.evaluate import Drive
from train.commands.layouts import BY_MAP
from train.evaluation.rollout import check_driver, config_of
from train.kinds import Fleet
from train.live.drive import WorldRunner
from train.live.server import Server
from train.live.world import MOST_ROBOTS, World, WorldSetting, live_floors
from warehouse_env.config import EnvConfig
from warehouse_env.maps.layouts import make_layout
from warehouse_env.planning import make_planner
from warehouse_env.render.pages import about_page, live_page

_LOOKS_EVERY = 0.2  # [s] between two checks whether the simulation has failed
_STOPS_IN = 2.0  # [s] at most


@dataclass(frozen=True)
class Live(Fleet, Drive):
    """Run a simulation on a page in the browser; set pace, policy, floor, robots and seed there."""

    policy: str = "shielded"
    """Policy to begin with: a name, or the folder of a trained one."""
    layout: Annotated[str, BY_MAP] = "paper46"
    """Floor to begin with: a name of `warehouse layouts`, or a file NAME.map or NAME.yaml."""
    robots: int = 32
    """Number of robots to begin with."""
    port: int = 0
    """Port of this machine to serve at; 0: any that is free."""
    open: bool = False
    """Open the page in the browser."""
    ranges: ClassVar = {"port": (0, 65_535), "robots": (1, MOST_ROBOTS), "seed": (0, 2**53)}

    def run(self) -> None:
        """Print the address and serve until Ctrl-C."""
        make_layout(self.layout)  # may raise before anything is served
        floors = live_floors(self.layout)
        setting = WorldSetting(
            self.policy, next(iter(floors)), self.robots, self.seed, self.planner, self.chosen(), self.kinds()
        )  # fmt: skip
        make_planner(self.planner)
        config = config_of(self.policy, EnvConfig(num_agents=self.robots), setting.given)
        check_driver(self.policy, config)
        about = about_live(floors, self.policy, self.robots)
        runner = WorldRunner(lambda: World(setting, floors))
        with Server(runner, live_page("Live warehouse", config.near_miss_gap, about), self.port) as server:
            threading.Thread(target=server.serve_forever, name="server", daemon=True).start()
            runner.start()
            print(f"the warehouse is at {server.address} (Ctrl-C ends it)", flush=True)
            if self.open:
                webbrowser.open(server.address)
            try:
                while runner.is_alive():
                    runner.join(_LOOKS_EVERY)
            except KeyboardInterrupt as stop:
                runner.stop(_STOPS_IN)
                stop.args = (_said(runner),)
                raise
            finally:
                server.shutdown()
        if runner.failed is not None:
            raise runner.failed


def about_live(floors: Iterable[str], policy: str, robots: int) -> dict[str, object]:
    """Return the choices that the page offers, and how the world begins."""
    return about_page(MOST_ROBOTS) | {
        "layers": about_page(robots)["layers"], "terms": [], "floors": list(floors), "most": MOST_ROBOTS,
        "policies": {policy: "the first one"} | {name: entry.summary for name, entry in POLICIES.items()},
    }  # fmt: skip


def _said(runner: WorldRunner) -> str:
    """Describe a world that was stopped."""
    if runner.drive is None:
        return "the world was still being made"
    world = runner.drive.world
    return f"the last world ran for {world.seconds:.0f} s and reached {world.moment()['totals'][0]} goals"
