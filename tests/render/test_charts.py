"""Charts write one complete picture each, and show what they are given."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from warehouse_env.errors import WarehouseError
from warehouse_env.files import complete_file
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render import chart_style, charts
from warehouse_env.render.colours import CONTACT, RGB, name_colours, robot_colour

image = pytest.importorskip("matplotlib.image")


def colours_of(path: Path) -> set[RGB]:
    pixels = (image.imread(path)[..., :3] * 255).round().astype(int)
    return set(map(tuple, np.unique(pixels.reshape(-1, 3), axis=0).tolist()))


def test_trajectories_mark_collisions(tmp_path: Path, grid: GridMap) -> None:
    tracks = [np.array([(0.5, 0.5), (10.5, 0.5)]), np.array([(8.5, 9.0), (8.5, 1.0)]), np.zeros((0, 2))]
    charts.trajectories(grid, tracks, np.zeros((0, 2)), "none", tmp_path / "a.png")
    charts.trajectories(grid, tracks, np.array([(8.5, 0.5)]), "one", tmp_path / "b.png")
    assert CONTACT not in colours_of(tmp_path / "a.png")
    assert CONTACT in colours_of(tmp_path / "b.png")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.png", "b.png"]


def test_floor_in_metres(grid: GridMap) -> None:
    figure = pytest.importorskip("matplotlib.figure").Figure()
    ax = figure.add_subplot()
    charts.draw_floor(ax, grid)
    assert (ax.get_xlim(), ax.get_ylim()) == ((0, 14), (0, 10))
    picture = ax.get_images()[0]
    assert picture.get_extent() == [0, 14, 0, 10]
    # The shelves' dark frames stand in the north-west: in the upper left of the picture.
    rows, columns = np.nonzero(np.asarray(picture.get_array()).mean(axis=-1) < 140)
    scale = picture.get_array().shape[1] / 14
    assert rows.mean() / scale == pytest.approx(3.0, abs=0.15)
    assert columns.mean() / scale == pytest.approx(5.0, abs=0.15)


def test_paths_keep_the_planners_colours(tmp_path: Path, grid: GridMap) -> None:
    way = np.array([(9, 0), (8, 1), (8, 2), (8, 3)])
    cells = {"aco": way, "pf_aco": way, "astar": np.zeros((0, 2), dtype=np.int64)}
    charts.paths(grid, cells, "paths", tmp_path / "p.png", {"aco": "3.41 cells"})
    assert set(name_colours(["aco", "pf_aco"]).values()) <= colours_of(tmp_path / "p.png")
    charts.paths(grid, {}, "no planner", tmp_path / "q.png")


def test_paths_side_by_side_keep_their_distance() -> None:
    line = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 3.0)])
    assert np.allclose(charts._sideways(line, 0.5), [(0, 0.5), (3.5, 0.5), (3.5, 3.0)])


def test_convergence_copes_with_runs_without_a_path(tmp_path: Path) -> None:
    best = np.array([[np.inf, 30.0, 27.0], [np.inf, np.inf, 28.0]])
    charts.convergence({"aco": best, "pf_aco": best[:1], "none": np.full((2, 3), np.inf)}, 27.0, tmp_path / "c.png")
    charts.convergence({"aco": np.zeros((1, 0))}, np.nan, tmp_path / "d.png")
    assert name_colours(["aco"])["aco"] in colours_of(tmp_path / "c.png")


@pytest.mark.parametrize(
    ("collisions", "goals"),
    [
        ([("follow", 16, 183.0, 150.0, 220.0), ("ppo", 16, 0.0, 0.0, 0.4)], [("follow", 16, 60.0, 50.0, 70.0)]),
        ([("follow", 8, 0.0, 0.0, 0.0)], []),
        ([("follow", 8, float("nan"), float("nan"), float("nan"))], [("follow", 8, 0.0, 0.0, 0.0)]),
        ([], [("mine", 4, 3.0, float("nan"), float("nan"))]),
        ([], []),
    ],
)
def test_bars_cope_with_zero_and_nothing(
    tmp_path: Path,
    collisions: list[tuple[str, int, float, float, float]],
    goals: list[tuple[str, int, float, float, float]],
) -> None:
    charts.collision_bars(collisions, goals, tmp_path / "bars.png", "title")
    assert (tmp_path / "bars.png").stat().st_size > 1000


def test_what_rounding_leaves_of_nothing_is_no_collision() -> None:
    """An interval of zeros may end at 1e-17, which is no decade to begin an axis with."""
    ax = chart_style.empty_figure(4.0, 3.0).subplots()
    charts.collision_scale(ax, [charts.Bar("greedy", 16, 0.0, 0.0, 3e-17), charts.Bar("ppo", 16, 1e-18, 0.0, 0.0)])
    assert (ax.get_yscale(), ax.get_ylim()) == ("linear", (0, 1))


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (183.4, "183"), (1834.0, "1834"), (3.2, "3.20"), (0.0412, "0.0412"), (np.nan, "no data")],
)
def test_figures(value: float, text: str) -> None:
    assert chart_style.figures(value) == text


def test_nothing_is_left_of_a_failed_picture(tmp_path: Path, grid: GridMap) -> None:
    def fail() -> None:
        with complete_file(tmp_path / "x.png") as part:
            part.write_bytes(b"half")
            raise RuntimeError("meanwhile")

    with pytest.raises(RuntimeError, match="meanwhile"):
        fail()
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "x.png").mkdir()
    with pytest.raises(WarehouseError, match="is a folder"):
        charts.trajectories(grid, [], np.zeros((0, 2)), "", tmp_path / "x.png")


def test_a_full_disk_gives_one_sentence(tmp_path: Path) -> None:
    def fill(error: OSError) -> None:
        with complete_file(tmp_path / "x.png"):
            raise error

    with pytest.raises(WarehouseError, match=r"cannot write .*x\.png: No space left"):
        fill(OSError(28, "No space left on device"))
    with pytest.raises(FileNotFoundError):
        fill(FileNotFoundError(2, "No such file", "other.txt"))
    assert list(tmp_path.iterdir()) == []


def test_pictures_have_the_rights_of_other_files(tmp_path: Path) -> None:
    (tmp_path / "plain").write_text("")
    with complete_file(tmp_path / "x.txt") as part:
        part.write_text("whole")
    assert (tmp_path / "x.txt").stat().st_mode == (tmp_path / "plain").stat().st_mode
    assert robot_colour(0) != robot_colour(1)
