"""Test map_server maps: pixels as Nav2 reads them, cells by hand, masks, yaw, one sentence for damage."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image

from train.job_files import pack, unpacked
from warehouse_env.config import EnvConfig
from warehouse_env.errors import MapError, WarehouseError
from warehouse_env.maps.fitting import load_floor
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.halls import map_server
from warehouse_env.maps.halls.hall import read_hall
from warehouse_env.maps.halls.saved import write_hall
from warehouse_env.maps.layouts import make_layout
from warehouse_env.render.heat_maps import cell_kinds

REAL = Path(__file__).parents[4] / "shared" / "buildings"
YAML = (
    "image: hall.pgm\nresolution: 0.5\norigin: [-3.0, 2.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"
)


def hall(folder: Path, grey: np.ndarray, text: str = YAML) -> str:
    """Write a hall and return its name."""
    map_server.write_pgm(grey.astype(np.uint8), folder / "hall.pgm")
    (folder / "hall.yaml").write_text(text)
    return str(folder / "hall.yaml")


def room(rows: int = 8, columns: int = 12) -> np.ndarray:
    """Return a free floor of pixels."""
    return np.full((rows, columns), 254)


@pytest.mark.parametrize(
    ("mode", "free", "negate", "expected"),
    [
        ("trinary", 0.25, 0, [100, 0, 0, map_server.UNKNOWN, map_server.UNKNOWN]),  # 205 is .19608
        ("trinary", 0.196, 0, [100, map_server.UNKNOWN, 0, map_server.UNKNOWN, map_server.UNKNOWN]),
        ("trinary", 0.196, 1, [0, 100, 100, map_server.UNKNOWN, map_server.UNKNOWN]),
        ("scale", 0.1, 0, [100, 17, 0, 73, 91]),  # (.19608 - .1) / .55, (.50196 - .1) / .55, (.6 - .1) / .55
        ("raw", 0.1, 0, [0, map_server.UNKNOWN, map_server.UNKNOWN, map_server.UNKNOWN, map_server.UNKNOWN]),
    ],
)
def test_pixels_are_read_as_in_nav2(tmp_path: Path, mode: str, free: float, negate: int, expected: list[int]) -> None:
    text = YAML.replace("0.25", str(free)).replace("negate: 0", f"negate: {negate}") + f"mode: {mode}\n"
    name = hall(tmp_path, np.array([[0, 205, 254, 127, 102]]), text)
    assert map_server.read_occupancy(Path(name)).values.tolist() == [expected]


def test_cells_of_a_hand_made_map(tmp_path: Path) -> None:
    """Cells of 1 m are 2 x 2 pixels from the upper left; half a cell remains at the bottom and right."""
    grey = room(7, 9)
    grey[0, 2] = 0  # a quarter of cell (0, 1)
    grey[5, 0:2] = 205  # unknown is free at .25
    (tmp_path / "hall.oneway").write_text("....\n" * 3)  # makes cells start at the corner
    grid = read_hall(hall(tmp_path, grey)).grid
    assert grid.occupied.astype(int).tolist() == [[0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]]
    assert grid.origin == (-3.0, 2.5)  # the lower half row is no cell
    assert grid.world(grid.centre((2, 0))).tolist() == [-2.5, 3.0]
    name = str(tmp_path / "hall.yaml:share=0.25")
    assert not make_layout(name).occupied.any()
    assert load_floor(EnvConfig(layout=name)).key == make_layout(name).key


def test_closed_aisles_are_reported(tmp_path: Path) -> None:
    """An aisle of 1 m lies half a cell off the grid: a robot of .6 m fits, but no cell does."""
    grey = room(20, 16)
    grey[4:16, 2:7], grey[4:16, 9:14] = 0, 0
    grey[0:2, 15] = 205
    found = read_hall(hall(tmp_path, grey, YAML.replace("0.25", "0.19")))
    report = "\n".join(found.report)
    assert "aisles close: 1 place where a robot has room, 4 cells long" in report
    assert "wall by unknown pixels alone: 1 cell" in report
    assert not read_hall(str(tmp_path / "hall.yaml:cell=0.5")).grid.occupied[4:16, 7:9].any()
    assert read_hall(str(tmp_path / "hall.yaml:unknown=floor")).grid.occupied.sum() == found.grid.occupied.sum() - 1


def test_masks_bar_cells_and_limit_speed(tmp_path: Path) -> None:
    name = hall(tmp_path, room())
    mask = map_server.Occupancy(np.zeros((4, 4), np.int8), 1.0, (-3.0, 2.0))
    mask.values[0, 1], mask.values[2, 2:] = 100, 50
    map_server.write_occupancy(mask, tmp_path / "m.yaml")
    found = read_hall(f"{name}:keepout=m.yaml,speed=m.yaml")
    assert np.argwhere(found.barred).tolist() == [[0, 1]]
    assert found.grid.speed is not None
    assert found.grid.speed[2].tolist() == [np.inf, np.inf, 0.75, 0.75, np.inf, np.inf]
    assert not np.isfinite(found.grid.speed[[0, 1, 3]]).any()


def mask_of(*rows: slice) -> np.ndarray:
    """Return a mask of 0.25 m pixels, marked in these rows and at the wall of a hall of 4 x 6 cells."""
    values = np.zeros((16, 24), np.int8)
    values[14:, 22:] = 100 * (len(rows) > 0)
    for row in rows:
        values[row, 4:8] = 100
    return values


@pytest.mark.parametrize("kind", ["keepout", "speed"])
@pytest.mark.parametrize(
    ("values", "resolution", "origin", "message"),
    [
        (mask_of(slice(4, 8)), 0.25, (-3.0, 2.0), None),
        (mask_of(slice(4, 9)), 0.25, (-3.0, 2.0), None),  # a row of pixels spills over into the next cell
        (mask_of(slice(4, 8)), 0.25, (-3.0, 6.0), "marks nothing of the map"),
        (mask_of(), 0.25, (-3.0, 2.0), "marks nothing of the map"),
        (mask_of(slice(4, 8)), 0.25, (-3.0, 3.0), "leaves 6 of 24 cells of floor out, which count as unmarked"),
        (np.pad(mask_of(), ((0, 12), (0, 0)), constant_values=100), 0.25, (-3.0, -1.0), "marks nothing of the map"),
        (mask_of(slice(4, 8), slice(15, 16)), 0.25, (-3.0, 2.0),
         "too little of 1 cell of 1 m is marked, as near (-1.5, 2.5) m; try a smaller cell="),
    ],
)  # fmt: skip
def test_ineffective_mask_is_noted(
    tmp_path: Path, kind: str, values: np.ndarray, resolution: float, origin: tuple[float, float], message: str | None
) -> None:
    map_server.write_occupancy(map_server.Occupancy(values, resolution, origin), tmp_path / "m.yaml")
    grey = room()
    grey[7, 11] = 0
    notes = read_hall(f"{hall(tmp_path, grey)}:share=0.3,{kind}=m.yaml").notes
    assert [note for note in notes if "m.yaml" in note and message and message in note] if message else not notes, notes


@given(
    hnp.arrays(np.bool_, st.tuples(st.integers(2, 7), st.integers(2, 7))),
    st.sampled_from([(1.0, None), (1.0, 0.25), (0.5, 0.25)]),
    st.tuples(st.integers(-50, 50), st.integers(-50, 50)),
    st.floats(-7, 7),
    st.randoms(),
)
@settings(max_examples=25, deadline=None)
def test_hall_round_trips(tmp_path_factory, occupied, sizes, origin, yaw, rng) -> None:  # type: ignore[no-untyped-def]
    occupied[0, 0] = False
    cell, resolution = sizes
    arrows = np.array([[rng.randrange(5) for _ in row] for row in occupied]) * ~occupied
    speed = np.array([[rng.choice([0.75, 1.2, np.inf]) for _ in row] for row in occupied])
    discs = [(0.3 * cell, 0.4 * cell, 0.2 * cell)][: rng.randrange(2) * bool(occupied.size - occupied.sum() > 1)]
    arrows[-1:, :1] *= not discs
    grid = GridMap(
        occupied, cell_size=cell, one_way=arrows, origin=origin, discs=discs, speed=speed, name="hall", yaw=yaw
    )
    name = write_hall(grid, tmp_path_factory.mktemp("h") / "hall.yaml", resolution)
    found = read_hall(name)
    assert (found.grid.occupied == grid.occupied).all()
    assert (found.grid.one_way == grid.one_way).all()
    assert found.grid.speed == pytest.approx(grid.speed)
    assert np.array_equal(found.grid.picks, grid.picks)
    assert np.array_equal(found.grid.stations, grid.stations)
    assert np.allclose(found.grid.discs, grid.discs)
    assert np.allclose(found.grid.world([(0, 0), (7, 1)]), grid.world([(0, 0), (7, 1)]))


def test_map_with_a_quarter_turn(tmp_path: Path) -> None:
    """After a quarter turn, the picture's rows run north in the map's frame and its columns west."""
    grey = room(2, 4)
    found = read_hall(hall(tmp_path, grey, YAML.replace("[-3.0, 2.0, 0.0]", "[-3.0, 2.0, 1.5707963267948966]")))
    assert found.grid.shape == (1, 2)
    assert found.grid.world([(0.0, 0.0), (1.5, 0.5)]).ravel() == pytest.approx([-3.0, 2.0, -3.5, 3.5])
    between = found.raster.cells(np.stack([np.linspace(-3.9, -3.1, 50), np.full(50, 3.0)], axis=-1))
    assert between.tolist() == [[0, 1]] * 50  # a line between two cells
    assert found.raster.centres(np.array([(0, 1)])).ravel() == pytest.approx([-3.5, 3.5])
    assert found.report[-1] == "its south-west corner is at (-3, 2) m of the map, and its x axis turned by 90 degrees"


def moved(points: np.ndarray, yaw: float) -> np.ndarray:
    """Turn points (x, y) about (0, 0) and move them by (40, -7) m, by complex numbers."""
    there = (points @ (1, 1j)) * np.exp(1j * yaw) + (40 - 7j)
    return np.stack([there.real, there.imag], axis=-1)


def route_graph(*lines: list[list[float]]) -> str:
    """Return a route graph of lines, each with its own nodes."""

    def feature(kind: str, where: object, **about: object) -> dict[str, object]:
        return {"type": "Feature", "properties": about, "geometry": {"type": kind, "coordinates": where}}

    nodes = [feature("Point", end, id=k) for k, end in enumerate(end for line in lines for end in line)]
    edges = [feature("LineString", line, id=100 + k, startid=2 * k, endid=2 * k + 1, cost=30.0)
             for k, line in enumerate(lines)]  # fmt: skip
    return json.dumps({"features": nodes + edges})


def moved_files(folder: Path, yaw: float) -> str:
    """Write a moved hall with all its files; return its name."""
    (folder / "t").mkdir()

    def at(*point: float) -> list[float]:
        found: list[float] = moved(np.array(point), yaw).tolist()
        return found

    for name, row, value in (("hall", 0, 0), ("keepout", 18, 100), ("speed", 20, 50)):
        values = np.zeros((24, 32), np.int8)
        values[4:8, 8:20] = 100 * (name == "hall")
        values[row : row + 2, 4:12] = value
        text = f"image: {name}.pgm\nresolution: 0.5\norigin: [{at(-3, 2)[0]}, {at(-3, 2)[1]}, {yaw}]\n"
        map_server.write_pgm(np.where(values < 0, 205, values).astype(np.uint8), folder / "t" / f"{name}.pgm")
        (folder / "t" / f"{name}.yaml").write_text(text + "mode: raw\n")
    picks, stations = [at(1.5, 12.5), at(9.4, 9.7)], [at(-2.5, 2.5)]
    both = {"picks": picks, "stations": stations}
    listed = {kind: [{"id": k, "x": x, "y": y} for k, (x, y) in enumerate(one)] for kind, one in both.items()}
    (folder / "t" / "hall.places.json").write_text(json.dumps(listed))
    (x, y), discs = at(9.7, 3.3), folder / "t" / "hall.discs.json"
    discs.write_text(json.dumps({"discs": [{"x": x, "y": y, "radius": 0.4}]}))
    (folder / "t" / "lanes.geojson").write_text(route_graph([at(-0.5, 9.5), at(10.5, 9.5)]))
    return f"{folder / 't' / 'hall.yaml'}:keepout=keepout.yaml,speed=speed.yaml,lanes=lanes.geojson"


@given(st.floats(-4, 4) | st.sampled_from([np.pi / 6, np.pi / 2, np.pi, -np.pi / 2]))
@settings(max_examples=20, deadline=None)
def test_hall_does_not_depend_on_yaw(tmp_path_factory, yaw) -> None:  # type: ignore[no-untyped-def]
    """Turn and move map, masks, places, discs and lanes together: the floor is the same, moved."""
    still, turned = (read_hall(moved_files(tmp_path_factory.mktemp("h"), angle)) for angle in (0.0, yaw))
    for name in ("occupied", "walls", "one_way", "picks", "stations", "speed"):
        assert np.array_equal(getattr(still.grid, name), getattr(turned.grid, name)), name
    assert np.allclose(still.grid.price, turned.grid.price)
    assert len(still.grid.picks) == 2
    assert still.barred.sum() == 4
    assert (still.grid.speed[10] == 0.75).sum() == 4 == np.isfinite(still.grid.speed).sum()
    assert (still.grid.one_way > 0).sum() > 5
    assert np.allclose(still.grid.discs, turned.grid.discs, atol=1e-5)
    assert len(still.grid.discs) == 1
    points = np.random.default_rng(0).uniform(0, 12, (20, 2))
    assert np.allclose(turned.grid.world(points), moved(points + np.array([-3, 2]), yaw))
    assert np.allclose(turned.grid.local(turned.grid.world(points)), points)
    assert len(still.notes) == len(turned.notes)
    assert np.array_equal(cell_kinds(still), cell_kinds(turned))


def test_mask_with_another_yaw_is_refused(tmp_path: Path) -> None:
    name = moved_files(tmp_path, 0.5)
    mask = tmp_path / "t" / "keepout.yaml"
    mask.write_text(mask.read_text().replace("0.5]", "0.6]"))
    with pytest.raises(
        MapError, match=r"keepout mask keepout.yaml has a yaw of 0.6 rad, the map 0.5; turn its picture"
    ):
        read_hall(name)


def test_other_picture_formats_are_read(tmp_path: Path) -> None:
    grey = room()
    grey[2:4, 2:4] = 0
    for name in ("hall.png", "hall.bmp"):
        Image.fromarray(grey.astype(np.uint8)).save(tmp_path / name)
        assert read_hall(f"{tmp_path / name}:resolution=0.5").grid.occupied.sum() == 1
        with pytest.raises(MapError, match=r"resolution=0\.05"):
            read_hall(str(tmp_path / name))
    colours = np.dstack([grey, grey, grey, np.where(np.arange(12) < 2, 0, 255) + 0 * grey]).astype(np.uint8)
    Image.fromarray(colours).save(tmp_path / "hall.png")  # its first two columns are transparent, so unknown
    assert read_hall(f"{tmp_path / 'hall.png'}:resolution=0.5").grid.occupied.sum() == 5
    (tmp_path / "p2.pgm").write_text("P2 # a comment\n2 1\n# another\n15\n0 15\n")
    assert map_server.read_picture(tmp_path / "p2.pgm").grey.tolist() == [[0, 255]]


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("image: hall.pgm", "image: ../hall.pgm", "same folder"),
        ("image: hall.pgm", "image: hall.txt", "not a picture"),
        ("image: hall.pgm", "image: no.pgm", "does not exist"),
        ("image: hall.pgm\n", "", "no entry image"),
        ("resolution: 0.5\n", "", "resolution must be a number"),
        ("resolution: 0.5", "resolution: true", "resolution must be a number"),
        ("-3.0", ".nan", "origin must be a number"),
        ("2.0, 0.0", "2.0, .inf", "origin must be a number"),
        ("[-3.0, 2.0, 0.0]", "3", "origin must be a list"),
        ("negate: 0", "negate: 7", "negate 7 must be 0 or 1"),
        ("0.65", "0.2", "must be below"),
        ("negate: 0", "negate: 0\nmode: [x]", "must be one of"),
        ("negate: 0", "a: &a [1]\nb: [*a, *a]", "alias"),
        ("negate: 0", "x: !!python/object/apply:os.system [ls]", "is no YAML"),
        (YAML, "- 1\n", "no entries"),
    ],
)
def test_wrong_yaml_is_one_sentence(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    name = hall(tmp_path, room(), YAML.replace(old, new))
    with pytest.raises(MapError, match=sentence) as raised:
        read_hall(name)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"P5 6000 6000 255\n", "make it coarser"),
        (b"P5 2 2 255\n\0", "not a readable picture"),
        (b"\x89PNG", "not a readable picture"),
        (b"P5 0 2 255\n", "not a readable picture"),
    ],
)
def test_wrong_picture_is_one_sentence(tmp_path: Path, content: bytes, sentence: str) -> None:
    name = hall(tmp_path, room())
    (tmp_path / "hall.pgm").write_bytes(content)
    with pytest.raises(MapError, match=sentence):
        read_hall(name)


@pytest.mark.parametrize(
    "parameter", ["cell=0", "share=2", "unknown=lava", "zz=1", "keepout=../x.yaml", "lanes=a.txt", "lanes_only=true",
            "cell=50", "resolution=1", "cell=x"],
)  # fmt: skip
def test_wrong_map_parameter_is_refused(tmp_path: Path, parameter: str) -> None:
    with pytest.raises(WarehouseError):
        read_hall(f"{hall(tmp_path, room())}:{parameter}")


def test_map_files_travel_with_jobs(tmp_path: Path) -> None:
    name = hall(tmp_path, room()) + ":keepout=m.yaml"
    map_server.write_occupancy(
        map_server.Occupancy(np.full((1, 1), 100, np.int8), 1.0, (-3.0, 2.0)), tmp_path / "m.yaml"
    )
    before, files = make_layout(name).key, pack([name])
    for file in tmp_path.iterdir():
        file.unlink()
    with unpacked(files):
        assert make_layout(name).key == before
