"""How a hall's map was read, and what is doubtful about it, as parts of an advice's page."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from train.reporting.page import PagePart, Shown
from warehouse_env.errors import counted
from warehouse_env.files import companion
from warehouse_env.maps.halls import places
from warehouse_env.maps.halls.hall import Hall, parse
from warehouse_env.render.hall_map import SMALL, cell_kinds, hall_map

_SIGNS = ("aisles close", "by unknown pixels", "lies beside")  # of doubtful lines in a hall's report


def hall_parts(hall: Hall, name: str) -> list[PagePart]:
    """Return two parts: the map with the floor over it, and what is doubtful; name: as it was typed."""
    label = f"The map of {hall.grid.name}, and the floor that robots drive on"
    caption = (
        f"{label}, in metres of the map's own frame. Robots drive on whole cells of {hall.grid.cell_size:g} m; what is "
        "sand-coloured is floor on the map, and none here."
    )
    read = [_sentence(line) for line in hall.report if not any(sign in line for sign in _SIGNS)]
    doubtful = [_sentence(line) for line in doubts(hall, name)]
    shown = [Shown(hall_map(hall, label), caption)]
    heading = "What is doubtful about it, and what settles it"
    parts = [PagePart("The hall as it was understood", pictures=shown, points=read), PagePart(heading, points=doubtful)]
    return [part for part in parts if part.points]


def doubts(hall: Hall, name: str) -> Iterator[str]:
    """Yield what may be wrong and how to settle it, one sentence each, the gravest first."""
    path, how = parse(name)
    if not companion(path, places.SUFFIX).exists() and how.lanes is None:
        picks, stations = len(hall.places["picks"]), len(hall.places["stations"])
        yield (
            f"pick faces and stations are guessed: {counted(picks, 'pick face')} beside straight obstacles, "
            f"{counted(stations, 'station')} along the rim; all figures here depend on them; "
            f"`warehouse places {path.name}` draws them with numbers and writes a file to correct them"
        )
    small = int((cell_kinds(hall) == SMALL).sum())
    if small:
        yield (
            f"{counted(small, 'cell')} that robots drive on hold something small, as table legs, kerbs, or specks of "
            f"the scanner; `{with_parameter(name, 'share=0')}` closes them"
        )
    yield from hall.notes
    yield from (line for line in hall.report if any(sign in line for sign in _SIGNS))


def with_parameter(name: str, parameter: str) -> str:
    """Return a hall's name without its folders, with one more parameter."""
    path, colon, given = name.partition(":")
    kept = [one for one in given.split(",") if colon and one.partition("=")[0] != parameter.partition("=")[0]]
    return f"{Path(path).name}:{','.join([*kept, parameter])}"


def _sentence(text: str) -> str:
    plain = text.partition(" ")[0].islower() and "." not in text.partition(" ")[0]  # and no file's name
    return f"{text[0].upper() if plain else text[0]}{text[1:]}."
