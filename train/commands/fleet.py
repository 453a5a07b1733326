"""`warehouse fleet`: write an episode as VDA 5050 messages, check messages, or judge a real fleet."""

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, ClassVar

import tyro
from rich.progress import Progress

from train.commands.layouts import BY_MAP
from train.fleet.build import episode_of
from train.fleet.check import check_log
from train.fleet.driven import fleet_table, load_simulated, row_of
from train.fleet.messages import LOG, VERSIONS, Names, write_log
from train.fleet.orders import Story, story_of
from train.fleet.publisher import Broker, broker_of, package, publish
from train.fleet.received import hear_log
from train.fleet.vehicle import messages_of, serial_of
from train.reporting.report import make_progress
from train.reporting.rows import RowFile
from warehouse_env.checked import Checked
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, counted
from warehouse_env.files import check_writable
from warehouse_env.maps.fitting import load_floor
from warehouse_env.maps.halls.saved import write_hall

_SHOWN = 20  # faults in words
_DAY = datetime(2026, 1, 1, tzinfo=UTC)  # when episodes in logs begin, so the same episode gives the same file
FOLDER, EPISODE = Path("results/fleet"), "episode.npz"


@dataclass(frozen=True)
class FleetCommand(Checked):
    """Speak VDA 5050: write a recorded episode as messages, check a log of messages (--check), or turn the messages of
    a real fleet into an episode (--listen) with the figures of an evaluation."""

    episode: tyro.conf.Positional[Path | None] = None
    """Episode to write as messages, a file of `warehouse record`."""
    out: Path | None = None
    """Folder for messages.jsonl and the floor, or with --listen for episode.npz (results/fleet; with --mqtt, nothing is
    written unless a folder is named)."""
    mqtt: str | None = None
    """Broker, HOST or HOST:PORT, to which each message is published when it is due."""
    speed: float | None = None
    """With --mqtt, simulated seconds per second (1)."""
    check: Path | None = None
    """Log to check, a file or folder with messages.jsonl: schemas, headers, orders, states. Exit code 1 for faults."""
    listen: Path | None = None
    """Log of a real fleet's messages, as `mosquitto_sub -F %J` prints them: a file, or a folder with messages.jsonl."""
    layout: Annotated[str | None, BY_MAP] = None
    """With --listen, the floor: a name of `warehouse layouts`, a file NAME.map, NAME.yaml of map_server in the
    vehicles' frame, or FILE.py:FUNCTION."""
    every: float | None = None
    """Seconds between two visualization messages of a vehicle (each step); with --listen, the episode's time step (as
    often as vehicles report)."""
    interface: str = "uagv"
    """First part of the topics that are written."""
    vda: int = Names.major
    """Version that is written: 2 for 2.1.0, 3 for 3.0.0. Logs are read in either."""
    json: Path | None = None
    """File for a row about what was checked or heard, as JSON lines."""
    ranges: ClassVar = {"speed": (0.01, 1000.0), "every": (0.001, 3600.0), "vda": (min(VERSIONS), max(VERSIONS))}

    def __post_init__(self) -> None:
        super().__post_init__()
        plain = self.interface.isprintable() and 0 < len(self.interface) <= 100 and not set(self.interface) & set("/+#")
        self._require(plain, "interface", "a part of a topic: some characters, none of / + #")

    def run(self) -> None:
        """Write, check or listen."""
        asked = [self.episode is not None, self.check is not None, self.listen is not None]
        if sum(asked) != 1:
            raise ConfigError("name an episode to write, --check LOG or --listen LOG: one of them")
        for used, name, what in (
            (self.episode is not None, "mqtt", "an episode"),
            (self.listen is not None, "layout", "--listen"),
            (self.mqtt is not None, "speed", "--mqtt HOST"),
        ):
            if getattr(self, name) and not used:
                raise ConfigError(f"--{name} goes with {what}")
        if self.episode is not None:
            self._write(self.episode)
        elif self.check is not None:
            self._check(self.check)
        elif self.listen is not None:
            self._listen(self.listen)

    def _write(self, path: Path) -> None:
        """Write or publish an episode's messages."""
        broker = None if self.mqtt is None else broker_of(self.mqtt)
        if broker is not None:
            package()
        folder = FOLDER if self.out is None and broker is None else self.out
        if folder is not None:
            check_writable(folder / LOG)
        begin = _DAY if broker is None else datetime.now(UTC)
        names, episode = Names("warehouse_env", self.interface, begin, self.vda), load_simulated(path)
        with make_progress() as progress:
            bar = progress.add_task("episode", total=len(episode.pose))
            story = story_of(episode, lambda: progress.advance(bar))
            count = 0
            if folder is not None:
                bar = progress.add_task("messages", total=len(episode.pose))
                count = write_log(messages_of(story, names, self.every, lambda: progress.advance(bar)), folder)
                floor = write_hall(story.replay.grid, folder / "floor.yaml")
            if broker is not None:
                count = self._publish(broker, story, names, progress)
        if folder is not None:
            print(f"wrote {count:,} messages of {counted(episode.config.num_agents, 'robot')} to {folder / LOG}")
            print(f"to check them: warehouse fleet --check {folder}; the floor for --listen: --map {floor}")

    def _publish(self, broker: Broker, story: Story, names: Names, progress: Progress) -> int:
        """Publish, and print how it went; return the number of messages."""
        bar = progress.add_task(f"to {broker.name}", total=len(story.replay.pose))
        messages = messages_of(story, names, self.every, lambda: progress.advance(bar))
        serials = map(serial_of, range(story.replay.config.num_agents))
        sent = publish(broker, messages, names, serials, self.speed or 1.0)
        late = f", the latest {sent.late:.1f} s behind its time" if sent.late > 1.0 else ""
        print(f"published {sent.messages:,} messages to {broker.name} under {names.interface}/{late}")
        return sent.messages

    def _check(self, path: Path) -> None:
        """Check a log; exit with 1 for faults."""
        rows = RowFile(self.json)
        with make_progress() as progress:
            bar = progress.add_task("lines", total=None)
            found = check_log(path, lambda: progress.advance(bar))
        listed = ", ".join(f"{count:,} {name}" for name, count in sorted(found.messages.items()))
        print(f"{counted(found.vehicles, 'vehicle')}, {found.seconds:.1f} s: {listed}")
        for fault in found.faults[:_SHOWN]:
            print(fault.sentence)
        more = f", the first {_SHOWN} above" if found.total > _SHOWN else ""
        print(f"{found.total or 'no'} fault{'s' * (found.total != 1)}{more}")
        faults = [fault._asdict() for fault in found.faults]
        rows.add([{"log": path, **found.messages, "vehicles": found.vehicles, "faults": found.total, "first": faults}])
        if found.total:
            raise SystemExit(1)

    def _listen(self, log: Path) -> None:
        """Make an episode of a log, write it, and print its figures."""
        if self.layout is None:
            raise ConfigError("name the fleet's floor with --layout NAME_OR_FILE")
        config, path = EnvConfig(self.layout, planner="astar"), (self.out or FOLDER) / EPISODE
        grid, rows = load_floor(config), RowFile(self.json)
        check_writable(path)
        with make_progress() as progress:
            bar = progress.add_task("messages", total=None)
            fleet = hear_log(log, lambda: progress.advance(bar))
            episode = episode_of(fleet, grid, config, self.every)
            episode.save(path)
            bar = progress.add_task("figures", total=len(episode.pose))
            row = row_of(episode, log, lambda: progress.advance(bar))
        fleet_table(row).print()
        rows.add([row])
        vehicles, seconds = len(episode.vehicles), (len(episode.pose) - 1) * episode.config.time_step
        print(
            f"{fleet.messages:,} messages of {counted(vehicles, 'vehicle')}, {seconds:.1f} s from {episode.begin}; "
            f"wrote the episode to {path}; to see it: warehouse replay {path} --html {path.with_suffix('.html')}"
        )
