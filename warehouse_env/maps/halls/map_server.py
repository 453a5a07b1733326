"""Maps of ROS 2's map_server: a YAML file and a picture beside it, read and written.

Rules of nav2_map_server: a level is p = grey / 255, occ = p with `negate`, else 1 - p. trinary: occupied from
`occupied_thresh` on, free up to `free_thresh`, else unknown. scale: the same, and between them a share. raw: the level
itself is the share in per cent, unknown above 100. Row 0 of a picture is the north edge. YAML is read safely, in time
and memory proportional to the file.
"""

import io
import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from warehouse_env.errors import MapError, shown
from warehouse_env.files import as_number, complete_file, read_bytes, read_text, write_text
from warehouse_env.maps.grid_map import turned

_DEEPEST = 16  # mappings and lists within each other


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """A safe loader, in C if available, that refuses duplicate names."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Return the entries of a mapping."""
        names = [(key.tag, key.value) for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        if len(set(names)) < len(names):
            raise yaml.constructor.ConstructorError(None, None, "a name is given twice", node.start_mark)
        made: dict[Any, Any] = super().construct_mapping(node, deep)
        return made


def read_yaml(path: Path, kind: str, most: int) -> Any:
    """Return the content of a file of at most `most` bytes; MapError, naming the `kind` of file.

    Aliases, which can make a short file endless, and more than 16 levels are refused.
    """
    text = read_text(path, kind, most)
    try:
        _check(text, path)
        return yaml.load(text, _Loader)
    except MapError:  # a ValueError as well
        raise
    except yaml.MarkedYAMLError as error:
        line = f", line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise MapError(f"{path}{line} is no YAML: {shown(error.problem)[1:-1]}") from None
    except (yaml.YAMLError, ValueError, TypeError, RecursionError, OverflowError) as error:
        raise MapError(f"{path} is no YAML: {shown(str(error))[1:-1]}") from None


def _check(text: str, path: Path) -> None:
    depth = 0
    for event in yaml.parse(text, _Loader):
        if isinstance(event, yaml.AliasEvent):
            raise MapError(f"{path} has an alias (*name), which it does not need; write the value itself")
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST:
            raise MapError(f"{path}, line {event.start_mark.line + 1} is deeper than {_DEEPEST} levels")


YAMLS = (".yaml", ".yml")
PICTURES = (".pgm", ".png", ".bmp")
MOST_PIXELS = 32_000_000
MODES = ("trinary", "scale", "raw")
UNKNOWN = -1
FREE_GREY, OCCUPIED_GREY, UNKNOWN_GREY = 254, 0, 205  # as map_saver writes them
FREE_THRESH, OCCUPIED_THRESH = 0.196, 0.65  # of plain pictures and what is written here: 205 is unknown
_LARGEST_YAML, _LARGEST_PICTURE = 64_000, 256_000_000  # [bytes]
_FARTHEST = 1e7  # [m] of an origin


@dataclass(frozen=True, eq=False)
class Occupancy:
    """A map: int8[H, W], per cent occupied or UNKNOWN for each pixel; row 0 is the north edge.

    resolution: [m] of a pixel. yaw: [rad], the heading of its rows in the map's frame. origin: (x, y) [m] of the lower
    left corner along the picture's sides: in the map's frame, turned back by yaw about (0, 0).
    """

    values: NDArray[np.int8]
    resolution: float
    origin: tuple[float, float] = (0.0, 0.0)
    yaw: float = 0.0

    @property
    def counts(self) -> tuple[int, int, int]:
        """Pixels that are occupied, free, and unknown; those between count as neither."""
        return tuple(int((self.values == value).sum()) for value in (100, 0, UNKNOWN))  # type: ignore[return-value]


class Picture(NamedTuple):
    """Levels uint8[H, W] from 0 (black) to 255, and opaque bool[H, W], or None if all are."""

    grey: NDArray[np.uint8]
    opaque: NDArray[np.bool_] | None = None


def read_occupancy(path: Path, resolution: float | None = None) -> Occupancy:
    """Return the map of a YAML file, or of a plain picture, which needs a resolution [m/pixel]; MapError."""
    if path.suffix.lower() in YAMLS:
        if resolution is not None:
            raise MapError(f"{path} holds its own resolution; leave out resolution={resolution}")
        about = _mapping(path)
        return _interpreted(path, read_picture(_image(path, about)), about)
    if resolution is None:
        raise MapError(f"{path} is a plain picture; give the width of a pixel in metres: {path.name}:resolution=0.05")
    about = {"resolution": resolution, "free_thresh": FREE_THRESH, "occupied_thresh": OCCUPIED_THRESH}
    return _interpreted(path, read_picture(path), {"origin": [0, 0, 0], **about})


def beside(path: Path, name: Any, what: str) -> Path:
    """Return the path of a file named in another: in its folder or below, so that both can travel; MapError."""
    inside = isinstance(name, str) and name.strip() and len(name) < 200 and name.isprintable()
    if not inside or Path(name).is_absolute() or ".." in Path(name).parts or "\\" in name:
        raise MapError(f"{path}: {what} {shown(name)} must be the name of a file in the same folder; copy it there")
    return path.parent / str(name)


def image_of(path: Path) -> Path:
    """Return the path of a YAML file's picture; MapError if it names none."""
    return _image(path, _mapping(path))


def _image(path: Path, about: dict[Any, Any]) -> Path:
    if "image" not in about:
        raise MapError(f"{path} has no entry image, the name of the map's picture")
    return beside(path, about["image"], "image")


def _mapping(path: Path) -> dict[Any, Any]:
    about = read_yaml(path, "map", _LARGEST_YAML)
    if not isinstance(about, dict):
        raise MapError(f"{path} is not a map of map_server: it has no entries like 'resolution: 0.05'")
    return about


def _number(path: Path, value: Any, name: str, low: float, high: float) -> float:
    number = as_number(value)  # YAML 1.1 takes 5e-2 for a word
    if not low <= number <= high:
        raise MapError(f"{path}: {name} must be a number from {low:g} to {high:g}")
    return number


def _interpreted(path: Path, picture: Picture, about: dict[Any, Any]) -> Occupancy:
    resolution = _number(path, about.get("resolution"), "resolution", 1e-3, 100.0)
    origin = about.get("origin")
    if not isinstance(origin, list) or len(origin) != 3:
        raise MapError(f"{path}: origin must be a list of x, y and yaw, as [0.0, 0.0, 0.0]")
    x, y, yaw = (_number(path, value, "origin", -_FARTHEST, _FARTHEST) for value in origin)
    mode, negate = about.get("mode", "trinary"), about.get("negate", 0)
    if mode not in MODES:
        raise MapError(f"{path}: mode {shown(mode)} must be one of {', '.join(MODES)}")
    if negate not in (0, 1):
        raise MapError(f"{path}: negate {shown(negate)} must be 0 or 1")
    if mode == "raw":
        free, occupied = 0.0, 1.0
    else:
        names = ("free_thresh", "occupied_thresh")
        free, occupied = (_number(path, about.get(name), name, 0.0, 1.0) for name in names)
        if free >= occupied:
            raise MapError(f"{path}: free_thresh {free:g} must be below occupied_thresh {occupied:g}")
    values = _levels(mode, bool(negate), free, occupied)[picture.grey]
    if picture.opaque is not None and mode != "raw":
        values = np.where(picture.opaque, values, np.int8(UNKNOWN))
    corner = turned((x, y), -yaw)
    return Occupancy(values, resolution, (float(corner[0]), float(corner[1])), math.remainder(yaw, math.tau))


def _levels(mode: str, negate: bool, free: float, occupied: float) -> NDArray[np.int8]:
    """Return int8[256]: the value of each grey level."""
    grey = np.arange(256)
    if mode == "raw":
        return np.where(grey <= 100, grey, UNKNOWN).astype(np.int8)
    occ = grey / 255.0 if negate else 1.0 - grey / 255.0
    between = np.rint((occ - free) / (occupied - free) * 100) if mode == "scale" else np.full(256, UNKNOWN)
    return np.where(occ <= free, 0, np.where(occ >= occupied, 100, between)).astype(np.int8)


def write_occupancy(occupancy: Occupancy, path: Path) -> None:
    """Write a map as a YAML file and a PGM of the same name beside it: trinary, or raw where it holds shares."""
    values, picture = occupancy.values, path.with_suffix(PICTURES[0])
    shares = bool(((values > 0) & (values < 100)).any())
    known = np.where(values >= 100, OCCUPIED_GREY, np.where(values == UNKNOWN, UNKNOWN_GREY, FREE_GREY))
    write_pgm((np.where(values == UNKNOWN, 255, values) if shares else known).astype(np.uint8), picture)
    origin = [*turned(occupancy.origin, occupancy.yaw).tolist(), occupancy.yaw]
    about = {
        "image": picture.name, "mode": "raw" if shares else "trinary",
        "resolution": occupancy.resolution, "origin": origin,
        "negate": 0, "occupied_thresh": OCCUPIED_THRESH, "free_thresh": FREE_THRESH,
    }  # fmt: skip
    write_text(path, yaml.safe_dump(about, sort_keys=False, default_flow_style=None, width=10_000, allow_unicode=True))


def read_picture(path: Path) -> Picture:
    """Return the picture in a file; MapError in one sentence if it is none or too large."""
    from PIL import Image  # imported late: few commands read pictures

    if path.suffix.lower() not in PICTURES:
        raise MapError(f"{path} is not a picture of a map; use one of {', '.join(PICTURES)}")
    content = read_bytes(path, "picture", _LARGEST_PICTURE)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about large pictures, whose size is checked here
            with Image.open(io.BytesIO(content), formats=("PNG", "BMP", "PPM")) as image:
                columns, rows = image.size
                if columns * rows > MOST_PIXELS:
                    size = f"{columns:,} x {rows:,} pixels"
                    raise MapError(f"{path} has {size}; make it coarser, to at most {MOST_PIXELS:,} in all")
                return _grey(image)
    except MapError:
        raise
    except Exception as error:  # decoders raise anything for a damaged picture
        raise MapError(f"{path} is not a readable picture: {shown(str(error))[1:-1]}") from None


def _grey(image: Any) -> Picture:
    """Return the mean of the colours, as map_server does, and where a picture is opaque."""
    if image.mode == "L":
        return Picture(np.asarray(image))
    if image.mode.startswith("I;16") or image.mode == "I":
        wide = np.asarray(image).astype(np.int64)
        return Picture((np.clip(wide, 0, 65535) // 257).astype(np.uint8))
    bands = np.asarray(image.convert("RGBA"))
    grey = np.rint(bands[..., :3].mean(axis=2)).astype(np.uint8)
    opaque = bands[..., 3] == 255
    return Picture(grey, None if opaque.all() else opaque)


def write_pgm(grey: NDArray[np.uint8], path: Path) -> None:
    """Write uint8[H, W] as a binary PGM (P5), completely or not at all."""
    rows, columns = grey.shape
    with complete_file(path) as part:
        part.write_bytes(b"P5\n%d %d\n255\n" % (columns, rows) + np.ascontiguousarray(grey).tobytes())
