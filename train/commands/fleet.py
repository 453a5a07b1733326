"""`warehouse fleet`: an episode as VDA 5050 messages, in a log or over MQTT; a check of such; a real fleet, judged."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.progress import Progress

from train.commands.layouts import BY_MAP
from train.fleet.broker import Broker, broker_of, package
from train.fleet.build import episode_of
from train.fleet.check import check_log
from train.fleet.driven import Driven, load_simulated
from train.fleet.listen import Heard, hear_broker, hear_log
from train.fleet.messages import LOG, Message, Names
from train.fleet.publisher import publish
from train.fleet.row import fleet_table, row_of, row_of_simulated
from train.fleet.secure import secure_context
from train.fleet.story import Story, story_of
from train.fleet.write import messages_of, write_floor, write_log
from train.reporting.report import counted, make_progress, tell
from train.reporting.rows import RowFile
from warehouse_env.checked import Checked
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, LostError, shown
from warehouse_env.files import check_writable, whereabouts
from warehouse_env.maps.loading import load_floor

_SHOWN = 20  # faults in words
_DAY = "2026-01-01T00:00:00+00:00"  # on which episodes in files begin, so that the same episode gives the same file
EPISODE = "episode.npz"
PATIENCE = 60.0  # [s]


@dataclass(frozen=True)
class FleetCommand(Checked):
    """Speak VDA 5050 2.1.0: write a recorded episode as its robots' messages, check such a log (--check), or make an
    episode of what a real fleet says (--listen) and judge it as evaluate does."""

    episode: tyro.conf.Positional[Path | None] = None
    """A file of `warehouse record`, to be written as messages."""
    out: Path | None = None
    """Folder: for messages.jsonl and the floor, or with --listen for episode.npz (results/fleet if left out; nothing is
    written if --mqtt is given alone)."""
    mqtt: str | None = None
    """Broker to which the messages are published as they fall due, HOST or HOST:PORT."""
    speed: float | None = None
    """With --mqtt, simulated seconds that a second lasts (1)."""
    check: Path | None = None
    """Check a log of messages, a file or a folder with messages.jsonl: schemas, headers, orders, states. Exit code 1 if
    anything is wrong."""
    listen: str | None = None
    """Make an episode of what vehicles say: a log, or a broker, HOST or HOST:PORT."""
    layout: Annotated[str | None, BY_MAP] = None
    """With --listen, the floor: a name of `warehouse layouts`, a file NAME.map, NAME.yaml of map_server, in whose frame
    the vehicles are, or FILE.py:FUNCTION."""
    beside: Path | None = None
    """With --listen, a recorded episode whose figures stand beside those of the fleet."""
    every: float | None = None
    """Seconds between two positions of a vehicle: as visualization they are sent so often (each step if left out); with
    --listen, the episode's time step (as often as vehicles say where they are)."""
    seconds: float | None = None
    """With --listen to a broker, end after so many seconds (when all vehicles are offline)."""
    patience: float | None = None
    """With --listen to a broker, end when nothing has come for so many seconds (60). A connection that breaks is made
    again for as long; exit code 3 if that fails."""
    interface: str = "uagv"
    """First part of the topics."""
    manufacturer: str = "warehouse_env"
    """Manufacturer that the messages name."""
    begin: str | None = None
    """When the episode begins, ISO 8601 (2026-01-01 in a log, now with --mqtt)."""
    user: str | None = None
    """User at the broker; the password is taken from WAREHOUSE_MQTT_PASSWORD."""
    tls: bool = False
    """Speak to the broker over TLS (port 8883 if none is named). So does each of the next three."""
    cafile: Path | None = None
    """Certificates of the authorities to trust, in PEM format (those of this machine)."""
    cert: Path | None = None
    """Certificate to show to a broker that asks for one, in PEM format; needs --key."""
    key: Path | None = None
    """Private key of --cert, in PEM format, without a passphrase."""
    seed: int | None = None
    """Which of an episode's worlds to write, by its seed (its first, if left out)."""
    json: Path | None = None
    """Write a row about what was done to this file as JSON lines; with --listen those of the fleet."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._between(0.01, 1000.0, "speed")
        self._between(0.001, 3600.0, "every")
        self._between(0.1, 1e7, "seconds", "patience")
        for name in ("interface", "manufacturer"):
            text = getattr(self, name)
            plain = text.isprintable() and 0 < len(text) <= 100 and not set(text) & set("/+#")
            self._require(plain, name, "a part of a topic: some characters, none of / + #")
        named = self.user is None or (self.user.isprintable() and 0 < len(self.user) <= 1000)
        self._require(named, "user", "a name of 1 to 1000 characters")

    def run(self) -> None:
        """Do what is asked for."""
        asked = [self.episode is not None, self.check is not None, self.listen is not None]
        if sum(asked) != 1:
            raise ConfigError("name an episode to write, --check LOG or --listen LOG_OR_HOST: one of them")
        if self.listen is None and (self.layout is not None or self.beside is not None):
            raise ConfigError("--layout and --beside go with --listen")
        if self.episode is None and self.mqtt is not None:
            raise ConfigError("--mqtt goes with an episode; a broker to listen to is named by --listen HOST")
        self._check_broker()
        if self.episode is not None:
            self._write(self.episode)
        elif self.check is not None:
            self._check(self.check)
        else:
            self._listen(str(self.listen))

    def _check_broker(self) -> None:
        """Raise ConfigError for what is said of a broker, or of listening to one, where there is none."""
        live = self.listen is not None and _is_broker(self.listen)
        for used, names, what in (
            (live or self.mqtt is not None, ("user", "tls", "cafile", "cert", "key"),
             "a broker: --mqtt HOST or --listen HOST"),
            (live, ("seconds", "patience"), "--listen HOST"),
            (self.mqtt is not None, ("speed",), "--mqtt HOST"),
        ):  # fmt: skip
            given = [f"--{name}" for name in names if getattr(self, name)]
            if given and not used:
                raise ConfigError(f"{' and '.join(given)} go{'es' * (len(given) == 1)} with {what}")

    def _write(self, path: Path) -> None:
        """Write or publish the messages of an episode."""
        broker = None if self.mqtt is None else self._broker(self.mqtt)
        folder = Path("results/fleet") if self.out is None and broker is None else self.out
        if folder is not None:
            check_writable(folder / LOG)
        begin, rows = self._begin(live=broker is not None), RowFile(self.json)
        names, episode = Names(self.manufacturer, self.interface, begin), load_simulated(path)
        world = self._world(path, episode.seeds)
        with make_progress() as progress:
            bar = progress.add_task("episode", total=len(episode.pose))
            story = story_of(episode, world, lambda: progress.advance(bar))
            count = 0
            if folder is not None:
                bar = progress.add_task("messages", total=len(episode.pose))
                count = write_log(messages_of(story, names, self.every, lambda: progress.advance(bar)), folder)
                floor = write_floor(story, folder)
            if broker is not None:
                count = self._publish(broker, story, names, progress)
        if folder is not None:
            print(f"wrote {count:,} messages of {counted(episode.config.num_agents, 'robot')} to {folder / LOG}")
            print(f"to check them: warehouse fleet --check {folder}; the floor for --listen: --map {floor}")
        rows.add([{
            "episode": path, "map": episode.grid.name, "robots": episode.config.num_agents, "messages": count,
            "seed": episode.seeds[world], "begin": names.stamp(0.0), "out": folder, "mqtt": self.mqtt,
        }])  # fmt: skip

    def _publish(self, broker: Broker, story: Story, names: Names, progress: Progress) -> int:
        """Publish, and say how it went."""
        bar = progress.add_task(f"to {broker.name}", total=len(story.replay.pose))
        messages = messages_of(story, names, self.every, lambda: progress.advance(bar))
        first = list(itertools.islice(messages, 2 * story.replay.config.num_agents))
        serials = dict.fromkeys(message.payload["serialNumber"] for message in first)
        all_messages: Iterator[Message] = itertools.chain(first, messages)
        sent = publish(broker, all_messages, names, serials, self.speed or 1.0)
        late = f", the latest {sent.late:.1f} s behind its time" if sent.late > 1.0 else ""
        print(f"published {sent.messages:,} messages to {broker.name} under {names.interface}/{late}")
        return sent.messages

    def _check(self, path: Path) -> None:
        """Check a log; exit with 1 if anything is wrong."""
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

    def _listen(self, source: str) -> None:
        """Make an episode of what vehicles say, write it, and print its figures."""
        folder, config = self.out or Path("results/fleet"), self._floor()
        grid, rows = load_floor(config), RowFile(self.json)
        check_writable(folder / EPISODE)
        beside = None if self.beside is None else load_simulated(self.beside)
        heard = self._hear(source, folder)
        episode = episode_of(heard.fleet, grid, config, self.every)
        episode.save(folder / EPISODE)
        found = [row_of(episode, source)]
        if beside is not None:
            with make_progress() as progress:
                bar = progress.add_task("beside", total=len(beside.pose))
                found += [row_of_simulated(beside, str(self.beside), lambda: progress.advance(bar))]
        fleet_table(found, episode.notes).print()
        rows.add(found)
        self._say(episode, heard, folder)

    def _say(self, episode: Driven, heard: Heard, folder: Path) -> None:
        """Say what was written, and that it was broken off where it was."""
        path = folder / EPISODE
        vehicles, seconds = len(episode.vehicles), (len(episode.pose) - 1) * episode.config.time_step
        print(
            f"{heard.why}: {heard.fleet.messages:,} messages of {counted(vehicles, 'vehicle')}, {seconds:.1f} s from "
            f"{episode.begin}; wrote the episode to {path}; to see it: warehouse replay {path} --html "
            f"{path.with_suffix('.html')}"
        )
        if heard.stopped is not None:
            if isinstance(heard.stopped, KeyboardInterrupt):
                raise type(heard.stopped)(f"what came is kept in {folder}") from None
            if isinstance(heard.stopped, LostError):
                raise LostError(f"{heard.stopped}; what came is kept in {folder}") from None
            raise heard.stopped

    def _hear(self, source: str, folder: Path) -> Heard:
        broker = self._broker(source) if _is_broker(source) else None
        with make_progress() as progress:
            bar = progress.add_task(f"listening to {source}", total=None)
            if broker is None:
                return hear_log(whereabouts(source), lambda: progress.advance(bar))
            tell(f"listening to {broker.name}; Ctrl-C ends it and keeps what came", progress.console)
            moved: Any = lambda: progress.advance(bar)  # noqa: E731
            return hear_broker(broker, self.interface, folder, self.patience or PATIENCE, self.seconds, moved)

    def _broker(self, text: str) -> Broker:
        package()
        files = (self.cafile, self.cert, self.key)
        secure = self.tls or any(file is not None for file in files)
        return broker_of(text, self.user, secure_context(*files) if secure else None)

    def _floor(self) -> EnvConfig:
        """Return a config that names the floor."""
        if self.layout is None:
            raise ConfigError("name the fleet's floor with --layout NAME_OR_FILE")
        return EnvConfig(self.layout, planner="astar")

    def _begin(self, live: bool) -> datetime:
        """Return when the episode begins."""
        if self.begin is None:
            return datetime.now(UTC) if live else datetime.fromisoformat(_DAY)
        try:
            begin = datetime.fromisoformat(self.begin)
            begin = begin if begin.tzinfo is not None else begin.replace(tzinfo=UTC)
            if 1970 < begin.year < 9000 and math.isfinite(begin.timestamp()):
                return begin
        except (ValueError, OverflowError):
            pass
        raise ConfigError(f"--begin {shown(self.begin)} must be a moment by ISO 8601, as 2026-01-01T06:00:00Z")

    def _world(self, path: Path, seeds: tuple[int, ...]) -> int:
        if self.seed is None:
            return 0
        if self.seed not in seeds:
            raise ConfigError(
                f"{path} has no world of seed {self.seed}; its seeds are {', '.join(map(str, seeds[:8]))}"
            )
        return seeds.index(self.seed)


def _is_broker(source: str) -> bool:
    """Whether what is listened to is a broker, by its name, and no log."""
    path = whereabouts(source)
    return not (path.exists() or path.suffix.lower() in (".jsonl", ".json", ".log", ".txt") or "/" in source)
