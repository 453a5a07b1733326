"""`warehouse places`: pick faces and stations of a hall, proposed, drawn with numbers, and kept to be edited."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import tyro

from train.reporting.report import require_charts
from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError
from warehouse_env.files import companion
from warehouse_env.maps.halls import places
from warehouse_env.maps.halls.hall import is_hall, parse, read_hall


@dataclass(frozen=True)
class PlacesCommand(Checked):
    """Propose where robots fetch and bring in a hall, number it in a picture, and write it to NAME.places.json.

    Edit that file by hand: it is read whenever the map is. Stations and lanes of another file fill it as well:
    warehouse places hall.yaml:lanes=hall.lif.json
    """

    map: tyro.conf.Positional[str]
    """The hall: NAME.yaml of map_server, or a picture with :resolution=0.05 behind its name."""
    png: Path | None = None
    """The picture (NAME.places.png beside the map if left out)."""
    propose: bool = False
    """Propose new places, and replace an existing file."""

    rewrites: ClassVar[tuple[str, ...]] = (places.SUFFIX,)

    def run(self) -> None:
        """Write the file, if there is none yet, and the picture."""
        if not is_hall(self.map):
            raise ConfigError(f"{self.map} is no map of a hall: it must be NAME.yaml or a picture")
        require_charts(self.png)
        path, _ = parse(self.map)
        file = companion(path, places.SUFFIX)
        there = file.exists() and not self.propose
        hall = read_hall(self.map, edited=there)
        if not there:
            places.write_places(hall.places, file)
        from warehouse_env.render.charts import draw_places

        picture = self.png or path.with_suffix(".places.png")
        picks, stations = ([place.name for place in hall.places[kind]] for kind in places.KINDS)
        draw_places(hall.grid, picks, stations, picture)
        for note in hall.notes:
            print(f"note: {note}")
        counts = " and ".join(f"{len(listed)} {kind}" for kind, listed in hall.places.items())
        print(f"{'read' if there else 'wrote'} {counts} {'from' if there else 'to'} {file}, drew them in {picture}")
