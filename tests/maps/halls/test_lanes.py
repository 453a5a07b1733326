"""Test lanes and places: arrows by hand, round trips, LIF's own examples, one sentence for damage."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis.extra import numpy as hnp
from PIL import Image

from tests.maps.halls.test_map_server import REAL, hall, room, route_graph
from warehouse_env.errors import MapError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.halls.building import write_building
from warehouse_env.maps.halls.cells import Raster
from warehouse_env.maps.halls.hall import read_hall
from warehouse_env.maps.halls.lanes import STEPS, Lane, Lanes, arrows, lay, prices
from warehouse_env.maps.halls.lif import read_lif, write_lif
from warehouse_env.maps.halls.places import cells_of, read_places
from warehouse_env.maps.halls.route_graph import read_route_graph, write_route_graph
from warehouse_env.maps.one_way import ARROWS

RASTER = Raster(3, 5, 1.0, (0.0, 0.0))


def lane(*points: tuple[float, float], speed: float = np.inf) -> Lane:
    return Lane("a", "s", "e", np.array(points), speed)


def drawn(lanes: list[Lane]) -> list[str]:
    found = lay(Lanes(lanes=lanes), np.ones((3, 5), np.bool_), RASTER)
    return ["".join(ARROWS[k] for k in row) for row in found.one_way.tolist()]


def test_arrows_follow_hand_made_lanes() -> None:
    east, west = lane((0.5, 1.5), (4.5, 1.5)), lane((4.5, 1.5), (0.5, 1.5))
    north = lane((2.5, 0.5), (2.5, 2.5))
    assert drawn([east]) == [".....", ".>>>.", "....."]
    assert drawn([east, west]) == ["....."] * 3
    assert drawn([east, west, north]) == [".....", "..^..", "....."]
    assert drawn([east, north]) == [".....", ".>^>.", "....."]  # robots may cross a one-way cell
    back = lane((1.5, 1.5), (0.5, 1.5)), lane((4.5, 1.5), (3.5, 1.5))
    assert drawn([east, *back]) == [".....", "..>..", "....."]
    assert drawn([lane((0.5, 0.5), (1.5, 0.5))]) == [".....", ".....", ">...."]


@given(hnp.arrays(np.bool_, (5, 6, 4)))
def test_arrows_keep_single_steps_and_bar_no_other(steps: np.ndarray) -> None:
    """Lost steps are counted; a step that lanes take in both directions is never barred."""
    grid_steps = steps.copy()
    grid_steps[:, -1, 0] = grid_steps[0, :, 1] = grid_steps[:, 0, 2] = grid_steps[-1, :, 3] = False
    one_way, lost = arrows(grid_steps)
    legal = GridMap(np.zeros((5, 6)), one_way=one_way).legal_moves[..., ::2]
    kept = single = 0
    for row, column, move in np.argwhere(grid_steps).tolist():
        ahead = (row + (0, -1, 0, 1)[move], column + (1, 0, -1, 0)[move])
        assert legal[row, column, move]
        if not grid_steps[(*ahead, (move + 2) % 4)]:
            single += 1
            kept += not legal[(*ahead, (move + 2) % 4)]
    assert kept == single - lost


def test_prices_follow_hand_made_lanes() -> None:
    east = lane((0.5, 1.5), (4.5, 1.5))
    open_floor = np.ones((3, 5), np.bool_)
    found = prices(lay(Lanes(lanes=[east]), open_floor, RASTER), 1.5)
    assert found[1, :4, 0].tolist() == [1.0] * 4
    assert found[1, 1, 4] == 1.5  # against it
    assert found[0, 0].tolist()[::2] == [1.5] * 4
    assert found[0, 0, 7] == 1.25  # south, then along the lane
    cheap = lane((0.5, 0.5), (4.5, 0.5))._replace(price=0.5)
    both = prices(lay(Lanes(lanes=[east, cheap]), open_floor, RASTER), 1.5)
    assert (both[2, 0, 0], both[1, 0, 0], both[0, 0, 0]) == (1.0, 2.0, 3.0)  # in proportion to the cheapest


def test_time_and_prices_multiply() -> None:
    """A step that takes twice as long on average costs 2 extra cells at a price of 1.5; slow robots lose less."""
    slow, price = np.array([[np.inf, 0.5]]), np.full((1, 2, 8), 1.5)
    assert GridMap(np.zeros((1, 2)), speed=slow, price=price).surplus[0, 0, 0] == 2.0
    assert GridMap(np.zeros((1, 2)), speed=slow, price=price).at_pace(0.5).surplus[0, 0, 0] == 0.5
    assert GridMap(np.zeros((1, 2))).surplus is None


ROWS = ["#####.....", "..........", ".########.", ".>>>>>>>>.", ".########.", "..........", ".<<<<<<<..", ".........."]


def streets() -> GridMap:
    letters = np.array([list(row) for row in ROWS])
    return GridMap(letters == "#", one_way=np.array([[max(0, ARROWS.find(x)) for x in row] for row in ROWS]),
                   cell_size=0.75, origin=(-3.0, 7.5), name="streets")  # fmt: skip


@pytest.mark.parametrize(("write", "read", "name"), [
    (write_lif, read_lif, "f.lif.json"), (write_route_graph, read_route_graph, "f.geojson"),
])  # fmt: skip
def test_lane_files_round_trip(tmp_path: Path, write: Any, read: Any, name: str) -> None:
    grid = streets()
    speed = np.where(np.arange(10) < 3, 0.7, np.inf) + np.zeros(grid.shape)
    grid = dataclasses.replace(grid, speed=speed)
    write(grid, tmp_path / name)
    kinds = set(re.findall(r'"type": "(\w*(?:Point|String))"', (tmp_path / name).read_text()))
    assert kinds == ({"Point", "MultiLineString"} if read is read_route_graph else set())  # types that Nav2 reads
    lanes, raster = read(tmp_path / name), Raster(*grid.shape, grid.cell_size, grid.origin)
    found = lay(lanes, ~grid.occupied, raster)
    assert not lanes.notes
    assert np.array_equal(found.one_way, grid.one_way)
    assert (found.speed[1, :3] == 0.7).all()
    dear = np.where(np.arange(10) < 3, 2.0, 1.0)[None, :, None] + np.zeros((*grid.shape, 8))
    priced = dataclasses.replace(grid, price=dear)
    write(priced, tmp_path / name)
    kept = lay(read(tmp_path / name), ~grid.occupied, raster).price[1, :9, 0]
    assert kept.tolist() == ([2.0] * 3 + [1.0] * 6 if read is read_route_graph else [1.0] * 9)  # LIF has no costs
    for kind, cells in (("picks", grid.picks), ("stations", grid.stations)):
        assert cells_of(lanes.places[kind], kind, ~grid.occupied, raster)[0].tolist() == cells.tolist()


@pytest.mark.skipif(not REAL.exists(), reason="the schema is not here")
def test_written_lif_is_valid(tmp_path: Path) -> None:
    validate = pytest.importorskip("jsonschema").validate
    write_lif(streets(), tmp_path / "f.json")
    validate(json.loads((tmp_path / "f.json").read_text()), json.loads((REAL / "LIF-1.0.0.schema.json").read_text()))


@pytest.mark.skipif(not REAL.exists(), reason="the examples are not here")
def test_lif_examples_are_read() -> None:
    """All files are read except the first, which has words in place of numbers."""
    files = sorted((REAL / "lif").iterdir())
    for file in files[1:]:
        assert read_lif(file).nodes
    with pytest.raises(MapError, match="'number' must be a finite number"):
        read_lif(files[0])


@pytest.mark.parametrize(("write", "name"), [(write_lif, "f.lif.json"), (write_route_graph, "f.geojson")])
def test_hall_uses_the_lanes_of_a_file(tmp_path: Path, write: Any, name: str) -> None:
    """The file sets directions and limits. Floor without lanes is closed; the map's own arrows are ignored."""
    occupied = np.zeros((4, 6), np.bool_)
    occupied[3] = True
    arrows, speed = np.zeros((4, 6), np.uint8), np.full((4, 6), 0.75)
    arrows[1, 1:5] = 1
    ends: Any = {"picks": [[0, 0]], "stations": [[2, 5]], "origin": (-3.0, 2.0)}
    write(GridMap(occupied, one_way=arrows, speed=speed, **ends), tmp_path / name)
    plain = hall(tmp_path, room())
    (tmp_path / "hall.oneway").write_text("......\n" * 3 + ">>>>>>\n")
    found = read_hall(f"{plain}:lanes={name},lanes_only=true,lanes_prefer=3")
    assert np.array_equal(found.barred, occupied)
    assert np.array_equal(found.grid.one_way, arrows)
    assert np.array_equal(found.grid.speed, np.where(occupied, np.inf, 0.75))
    assert found.grid.picks.tolist() == [[0, 0]]
    assert found.grid.stations.tolist() == [[2, 5]]
    assert found.notes == ("hall.oneway is not used: the lanes give the directions",)
    assert read_hall(f"{plain}:lanes={name},lanes_prefer=3").grid.price[3, 0, 0] == 3.0  # type: ignore[index]


def test_lanes_off_the_floor_are_noted() -> None:
    lanes = Lanes(lanes=[lane((0.5, 1.5), (4.5, 1.5), speed=0.5), lane((0.0, 0.0), (1e9, 0.0))])
    floor = np.ones((3, 5), np.bool_)
    floor[1, 2] = False
    assert lay(lanes, floor, RASTER).speed[1].tolist() == [0.5, 0.5, np.inf, 0.5, 0.5]
    assert "2 of 2 lanes leave the floor" in lanes.noted()[0]


def test_dead_ends_of_a_route_graph_without_places_are_stations(tmp_path: Path) -> None:
    file = graph(tmp_path, lambda data: [one["properties"].pop("metadata", None) for one in data["features"]])
    assert [(place.x, place.y) for place in read_route_graph(file).places["stations"]] == [(0.5, 0.5), (2.5, 0.5)]


def test_lane_costs_are_kept_or_noted(tmp_path: Path) -> None:
    def edit(data: Any) -> None:
        edges = [one["properties"] for one in data["features"] if one["geometry"]["type"] == "MultiLineString"]
        edges[0]["cost"], edges[1]["cost"], edges[2]["cost"] = 3.0, 0.0, 1e9
        edges[2]["id"] = edges[1]["id"]

    read = read_route_graph(graph(tmp_path, edit, GridMap(np.zeros((1, 3)), cell_size=2.0)))
    assert [one.price for one in read.lanes] == [1.5, 1.0, 1000.0, 1.0]
    assert any("is clipped" in note for note in read.noted())
    assert any("used more than once" in note for note in read.noted())


def change(data: Any, path: list[Any], value: Any) -> Any:
    for key in path[:-1]:
        data = data[key]
    data[path[-1]] = value


FIRST = ["layouts", 0]


@pytest.mark.parametrize(
    ("path", "value", "sentence"),
    [
        (["layouts"], [], "list of one or more"),
        ([*FIRST, "nodes"], 3, "nodes must be a list"),
        ([*FIRST, "nodes", 0], 3, "a node is 3"),
        (["metaInformation", "lifVersion"], "2.0.0", "lifVersion '2.0.0' is not read; versions 0 and 1 are"),
        (["metaInformation", "lifVersion"], "v3", "lifVersion 'v3' is not read"),
        ([*FIRST, "nodes", 0, "nodeId"], "r0c1", "nodeId 'r0c1' is used by two nodes"),
        ([*FIRST, "edges", 0, "edgeId"], "r0c1-r0c0", "edgeId 'r0c1-r0c0' is used by two edges"),
        ([*FIRST, "nodes", 0, "nodeId"], None, "nodeId None must be a text"),
        ([*FIRST, "nodes", 0, "nodePosition", "x"], float("nan"), "finite number"),
        ([*FIRST, "nodes", 0, "nodePosition"], [1, 2], "position of"),
        ([*FIRST, "edges", 0, "endNodeId"], "nowhere", "which does not exist"),
        ([*FIRST, "edges", 0, "vehicleTypeEdgeProperties", 0, "maxSpeed"], -1, "must be above 0"),
        ([*FIRST, "stations", 0, "interactionNodeIds"], ["nowhere"], "which does not exist"),
    ],
)
def test_wrong_lif_is_one_sentence(tmp_path: Path, path: list[Any], value: Any, sentence: str) -> None:
    with pytest.raises(MapError, match=sentence):
        read_lif(lif(tmp_path, lambda data: change(data, path, value)))


def test_other_levels_and_closed_edges_of_a_lif_are_noted(tmp_path: Path) -> None:
    def edit(data: Any) -> None:
        data["metaInformation"] = {}
        for edge in data["layouts"][0]["edges"]:
            edge["vehicleTypeEdgeProperties"] = []
        data["layouts"][0]["stations"] = [{"stationId": "s", "interactionNodeIds": ["r0c0", "up"]}]
        up = {"nodeId": "up", "nodePosition": {"x": 0, "y": 0}}
        data["layouts"].append({"layoutId": "2", "layoutLevelId": "2", "nodes": [up]})

    found = read_lif(lif(tmp_path, edit))
    assert [place.name for place in found.places["stations"]] == ["s"]
    for part in ("lifVersion is missing", "a layout of another level", "none of its 4 edges is open to a vehicle"):
        assert any(part in note for note in found.noted())


def edited(file: Path, write: Any, edit: Callable[[Any], object], grid: GridMap | None = None) -> Path:
    """Write a floor's lanes, apply `edit` to the data, and return the file."""
    write(grid or GridMap(np.zeros((1, 3))), file)
    data = json.loads(file.read_text())
    edit(data)
    file.write_text(json.dumps(data))
    return file


def lif(folder: Path, edit: Callable[[Any], object], grid: GridMap | None = None) -> Path:
    return edited(folder / "f.json", write_lif, edit, grid)


def graph(folder: Path, edit: Callable[[Any], object], grid: GridMap | None = None) -> Path:
    return edited(folder / "f.geojson", write_route_graph, edit, grid)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({}, None), ({"degree": None, "knotVector": [0, 0, 0.5, 1, 1]}, None), ({"weight": None}, None),
        ({"shift": 0.5}, None), ({"shift": 20.0}, "no NURBS"), ({"degree": 7}, "no NURBS"),
        ({"knotVector": [1, 1, 1, 0, 0, 0]}, "no NURBS"), ({"knotVector": None}, "no NURBS"),
        ({"knotVector": [-1e299] * 3 + [1e299] * 3}, None), ({"weight": -1}, "no NURBS"),
        ({"controlPoints": []}, "no NURBS"),
    ],
)  # fmt: skip
def test_trajectory_is_followed_or_noted(tmp_path: Path, change: dict[str, Any], expected: str | None) -> None:
    def bend(data: Any) -> None:
        by, scale = change.get("shift", 0.0), change.get("x", 1.0)
        points = [{"x": x * scale + by, "y": y + by, "weight": change.get("weight", 1.0)}
                  for x, y in ((0.5, 0.5), (1.0, 0.8), (1.5, 0.5))]  # fmt: skip
        curve = {"degree": 2, "knotVector": [0, 0, 0, 1, 1, 1], "controlPoints": points} | change
        data["layouts"][0]["edges"][0]["vehicleTypeEdgeProperties"][0]["trajectory"] = curve

    found = read_lif(lif(tmp_path, bend))
    assert (len(found.lanes[0].line) == 2) == (expected is not None)
    assert np.isfinite(found.lanes[0].line).all()
    assert any(expected in note and "straight" in note for note in found.noted()) if expected else not found.notes
    beside = [note for note in found.noted() if "its trajectory ends 0.71 m from its node" in note]
    assert len(beside) == (change.get("shift") == 0.5)


@pytest.mark.parametrize(
    ("path", "value", "sentence"),
    [
        (["features"], {}, "not a route graph"),
        (["features", 0, "properties"], None, "no properties"),
        (["features", 0, "properties", "id"], 1, "is used by two nodes"),
        (["features", 0, "geometry", "coordinates"], ["x"], "coordinates"),
        (["features", 0, "geometry", "coordinates"], [1e300, 0], "coordinates"),
        (["features", -1, "properties", "endid"], 99, "which does not exist"),
        (["features", -1, "properties", "metadata"], {"speed_limit": 0}, "above 0"),
        (["features", -1, "properties", "cost"], -1, "cost -1 must be a number"),
    ],
)
def test_wrong_route_graph_is_one_sentence(tmp_path: Path, path: list[Any], value: Any, sentence: str) -> None:
    with pytest.raises(MapError, match=sentence):
        read_route_graph(graph(tmp_path, lambda data: change(data, path, value)))


def test_hand_written_places_are_read(tmp_path: Path) -> None:
    name = hall(tmp_path, room())
    file = tmp_path / "hall.places.json"
    file.write_text(
        '{"picks": [{"x": -2.5, "y": 2.5}, {"x": -2.4, "y": 2.4}], "stations": [{"id": 7, "x": 99, "y": 0}]}'
    )
    with pytest.raises(MapError, match="none of the 1 stations is on floor"):
        read_hall(name)
    file.write_text(file.read_text().replace("99", "2.9").replace('"y": 0', '"y": 5.9'))
    found = read_hall(name)
    assert (found.grid.picks.tolist(), found.grid.stations.tolist()) == ([[3, 0]], [[0, 5]])
    assert "share a cell" in found.notes[0]
    twice = '{"picks": [{"id": 1, "x": 1, "y": 1}, {"id": 1, "x": 2, "y": 1}]}'
    for text in ("{}", "[", '{"picks": [{"x": 1}]}', twice, '{"picks": [{"x": NaN, "y": 1}]}', '{"picks": []}',
                 "[" * 100_000, '{"picks": [3]}'):  # fmt: skip
        file.write_text(text)
        with pytest.raises(MapError):
            read_places(file)


@pytest.mark.parametrize("yaw", [0.0, 2.5])
def test_open_rmf_building_describes_the_floor(tmp_path: Path, yaw: float) -> None:
    """Read the file as Open-RMF's tools do: y up, metres by the measurement, two-way lanes split."""
    grid, path = dataclasses.replace(streets(), yaw=yaw), tmp_path / "h.building.yaml"
    grid = dataclasses.replace(grid, speed=np.where(np.arange(10) < 3, 0.7, np.inf) + np.zeros(grid.shape))
    corners = yaml.safe_load(write_building(grid, path, 0.25))["streets"]
    building = yaml.safe_load(path.read_text())
    level = building["levels"]["streets"]
    assert (building["name"], building["coordinate_system"], building["lifts"]) == ("streets", "reference_image", {})
    with Image.open(tmp_path / level["drawing"]["filename"]) as drawing:
        black = np.asarray(drawing) == 0
    assert np.array_equal(black, grid.occupied.repeat(3, axis=0).repeat(3, axis=1))
    ((first, last, about),) = level["measurements"]
    assert about == {"distance": [3, 7.5]}  # ten cells of .75 m
    metres = 7.5 / (level["vertices"][last][0] - level["vertices"][first][0])
    points = np.array([complex(x, -y) * metres for x, y, *_ in level["vertices"]])
    rmf, robot = (np.array(corners[frame]) @ (1, 1j) for frame in ("rmf", "robot"))
    turn = (robot[2] - robot[0]) / (rmf[2] - rmf[0])
    assert abs(turn) == pytest.approx(1.0, abs=1e-3)  # the same scale
    there = robot[0] + (points[:-2] - rmf[0]) * turn
    assert there == pytest.approx(grid.world(grid.centre(grid.free_cells)) @ (1, 1j), abs=0.002)
    cells, found = grid.free_cells.tolist(), {}
    for start, end, about in level["lanes"]:
        assert (about["graph_idx"], about["orientation"]) == ([2, 0], [1, ""])
        for ends in ((start, end), (end, start))[: 1 + about["bidirectional"][1]]:
            found[ends] = about["speed_limit"]
    steps = [(cells.index([r, c]), cells.index([r + a, c + b]))
             for r, c in cells for m, (a, b) in enumerate(STEPS) if grid.legal_moves[r, c, 2 * m]]  # fmt: skip
    assert found.keys() == set(steps)
    slow = {ends for ends, limit in found.items() if limit == [3, 0.7]}
    assert slow == {(a, b) for a, b in found if min(cells[a][1], cells[b][1]) < 3}
    pick = level["vertices"][cells.index(grid.picks[1].tolist())]
    assert pick[3:] == ["pick 2", {"pickup_dispenser": [1, "pick 2"]}]


def test_contradictions_in_lif_are_noted_with_numbers(tmp_path: Path) -> None:
    """Edges of 1 m state lengths of 1.05, 1.5 and "0.2" m; nodes state headings of two vehicle types."""

    def edit(data: Any) -> None:
        layout = data["layouts"][0]
        layout["edges"][0]["length"], layout["edges"][1]["length"] = 1.05, 1.5
        layout["edges"][2]["vehicleTypeEdgeProperties"][0]["length"] = "0.2"
        for node, thetas in zip(layout["nodes"], ([0, 6.2832], [0.5, 1.0], [3.14159, -3.14159]), strict=True):
            node["vehicleTypeNodeProperties"] = [{"vehicleTypeId": "v", "theta": theta} for theta in thetas]
            node["vehicleTypeNodeProperties"].append({"vehicleTypeId": "w", "theta": 2})

    assert read_lif(lif(tmp_path, edit)).noted() == [
        "node 'r0c1' of layout 'unnamed': vehicle 'v' has headings of 0.5 and 1 rad",
        "edge 'r0c1-r0c2' of layout 'unnamed': its length is 1.5 m, but its nodes are 1.00 m apart",
        "edge 'r0c1-r0c0' of layout 'unnamed': its length is 0.2 m, but its nodes are 1.00 m apart",
    ]

    wrong = lif(tmp_path, lambda data: [one.update(length=9) for one in data["layouts"][0]["edges"]], streets())
    assert read_lif(wrong).noted()[5:] == [f"{len(read_lif(wrong).lanes) - 5} more edges with a wrong length"]


@pytest.mark.parametrize(("length", "expected"), [(2.236, []), (1.0, ["its length is 1 m, but its course is 2.24 m"])])
def test_stated_length_is_compared_with_the_trajectory(tmp_path: Path, length: float, expected: list[str]) -> None:
    """The trajectory detours over (1, 1.5): two sides of 1.118 m; its nodes are 1 m apart."""

    def edit(data: Any) -> None:
        edge = data["layouts"][0]["edges"][0]
        corners = [{"x": x, "y": y} for x, y in ((0.5, 0.5), (1, 1.5), (1.5, 0.5))]
        curve = {"degree": 1, "knotVector": [0, 0, 0.5, 1, 1], "controlPoints": corners}
        edge["vehicleTypeEdgeProperties"][0]["trajectory"], edge["length"] = curve, length

    assert [note.split(": ")[1] for note in read_lif(lif(tmp_path, edit)).noted()] == expected


@pytest.mark.parametrize("yaw", [0.0, 1.0])
def test_lane_too_narrow_for_the_robot_is_noted(tmp_path: Path, yaw: float) -> None:
    """Walls leave .5 m around the upper lane, too little for a robot of .6 m, and .7 m around the lower one."""
    grey = room(80, 80)
    grey[15, 40], grey[26, 40] = 0, 0  # the lane lies between rows 20 and 21, five pixels from both
    grey[55, 40], grey[70, 40] = 0, 0
    name = hall(tmp_path, grey, f"image: hall.pgm\nresolution: 0.05\norigin: [0, 0, {yaw}]\nmode: scale\n"
                                "occupied_thresh: 0.65\nfree_thresh: 0.25\n")  # fmt: skip
    cosine, sine = np.cos(yaw), np.sin(yaw)
    lines = [[[x * cosine - y * sine, x * sine + y * cosine] for x in (0.3, 3.7)] for y in (2.95, 0.85)]
    (tmp_path / "l.geojson").write_text(route_graph(*lines))
    found = read_hall(f"{name}:lanes=l.geojson,cell=0.5,share=0.3")
    (note,) = [note for note in found.notes if "does not fit" in note]
    assert note.startswith("edge '100': a robot 0.6 m wide does not fit near (")
    assert note.endswith("m, where 0.45 m are free around the lane")
    x, y = (float(part) for part in note.split("(")[1].split(")")[0].split(", "))
    assert (x, y) == pytest.approx((2 * cosine - 2.95 * sine, 2 * sine + 2.95 * cosine), abs=0.15)
