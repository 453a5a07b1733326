"""An entry: what a policy did on the fixed set, as one file that says by hashes what it was made of."""

from __future__ import annotations

import hashlib
import json
import random
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from train.evaluation.rollout import Experiment, run
from train.leaderboard.cases import CASES, FIELD, TRACKS, VERSION, Case, experiments, set_hash
from train.reporting.rows import Row, plain
from warehouse_env import __version__
from warehouse_env.errors import WarehouseError
from warehouse_env.files import read_json, write_text

COLUMNS = (
    "track", "layout", "robots", "seed", "goals_per_robot_hour", "late_goals_per_robot_hour", "collisions_robot",
    "collisions_shelf", "robot_km", "stuck", "longest_standing_s",
)  # fmt: skip
_KNOWN_BY = COLUMNS[:4]
_LARGEST_FILE = 64_000_000  # [bytes]
SHIPPED = Path(__file__).parent / "entries"  # of the shipped policies


@dataclass(frozen=True)
class Entry:
    """What stands in the file, but for the hash of it all."""

    policy: str  # its name on the board
    made_of: str  # hash of its weights or source; "" of one that ships with this version
    rows: tuple[Row, ...]
    version: str = __version__
    benchmark: int = VERSION
    set: str = ""  # see `set_hash`

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON types: a row is a list of the values of COLUMNS, in the order of the set."""
        said = {"benchmark": self.benchmark, "set": self.set, "version": self.version, "policy": self.policy}
        rows = [[row[name] for name in COLUMNS] for row in self.rows]
        body = {**said, "made_of": self.made_of, "columns": list(COLUMNS), "rows": rows}
        return {**body, "hash": _hash(body)}


def make_entry(policy: str, made_of: str, rows: Iterable[tuple[str, Row]], cases: Sequence[Case] = CASES) -> Entry:
    """Return the entry of rows of `warehouse evaluate`'s form, each with its track."""
    shortened = tuple({"track": track, **{name: plain(row[name]) for name in COLUMNS[1:]}} for track, row in rows)
    return Entry(policy, made_of, shortened, set=set_hash(cases))


def write_entry(entry: Entry, path: Path) -> None:
    """Write an entry, a row a line."""
    data = entry.to_dict()
    rows = ",\n  ".join(map(json.dumps, data.pop("rows")))
    head = json.dumps(data, indent=1).removesuffix("\n}")
    write_text(path, f'{head},\n "rows": [\n  {rows}\n ]\n}}\n')


def read_entry(path: Path) -> Entry:
    """Read an entry; WarehouseError says in one sentence if it is none, or was changed after it was written."""
    data = read_json(path, "entry", _LARGEST_FILE, WarehouseError)
    if not isinstance(data, dict) or not isinstance(data.get("benchmark"), int):
        raise WarehouseError(f"{path} is no entry of the benchmark: make one with warehouse benchmark --policy NAME")
    if data["benchmark"] != VERSION:
        raise WarehouseError(f"{path} is of version {data['benchmark']} of the benchmark; this is version {VERSION}")
    if data.pop("hash", None) != _hash(data):
        raise WarehouseError(f"{path} was changed after it was written: its hash is another; drive the policy again")
    if data.get("columns") != list(COLUMNS) or not all(_is_row(values) for values in data.get("rows", [None])):
        raise WarehouseError(f"{path} has not the columns of the benchmark: {', '.join(COLUMNS)}")
    rows = tuple(dict(zip(COLUMNS, values, strict=True)) for values in data["rows"])
    texts = {name: str(data.get(name, "")) for name in ("policy", "made_of", "version", "set")}
    return Entry(rows=rows, benchmark=VERSION, **texts)


def _is_row(values: object) -> bool:
    if not isinstance(values, list) or len(values) != len(COLUMNS):
        return False
    texts, numbers = values[:2], values[2:]
    sound = all(isinstance(one, int | float) and not isinstance(one, bool) for one in numbers)
    return values[0] in TRACKS and all(isinstance(one, str) for one in texts) and sound


def _hash(data: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def faults(entry: Entry, cases: Sequence[Case] = CASES) -> Iterator[str]:
    """Yield in sentences why an entry does not stand beside others of this version; nothing if it does."""
    if entry.set != set_hash(cases):
        yield f"{entry.policy} drove another set ({entry.set}) than this version's ({set_hash(cases)})"
        return
    given = [tuple(row[name] for name in _KNOWN_BY) for row in entry.rows]
    driven = {FIELD, *(row["track"] for row in entry.rows)}
    every = ((track, one) for track, one in experiments("follow", cases) if track in driven)
    wanted = [_known_by(track, one, seed) for track, one in every for seed in one.seeds]
    if given != wanted:
        missing = len(set(wanted) - set(given))
        yield f"{entry.policy} has {len(given)} episodes in its file, of {len(wanted)} of the set {missing} are missing"


def drive_again(entry: Entry, policy: str, count: int, cases: Sequence[Case] = CASES) -> Iterator[str]:
    """Drive `count` episodes of an entry again, chosen by its content; yield in sentences what is not the same."""
    known = {tuple(row[name] for name in _KNOWN_BY): row for row in entry.rows}
    episodes = [(track, one, k) for track, one in experiments(policy, cases) for k in one.episodes]
    chosen = random.Random(entry.to_dict()["hash"]).sample(episodes, min(count, len(episodes)))
    for track, one, k in chosen:
        row = run(replace(one, episodes=(k,)))[0]
        told = known[_known_by(track, one, one.seed + k)]
        for name in COLUMNS[4:]:
            if plain(row[name]) != told[name]:
                where = f"{track}, {one.place}, {one.config.num_agents} robots, seed {one.seed + k}"
                yield f"{where}: {name} is {plain(row[name])}, the entry says {told[name]}"


def _known_by(track: str, experiment: Experiment, seed: int) -> tuple[str, str, int, int]:
    return track, experiment.place, experiment.config.num_agents, seed
