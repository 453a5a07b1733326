"""One moment of a warehouse as a picture, drawn in memory: no display is needed."""

import importlib.util
import math
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import RobotSpec
from warehouse_env.errors import ConfigError, counted
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render import sprites
from warehouse_env.render.colours import CONTACT, DEADLOCK, RGB, WAITING, mix, robot_colour
from warehouse_env.render.extras import load
from warehouse_env.render.floor import FLOOR, floor_image
from warehouse_env.render.replay import goal_poses, places, totals_of
from warehouse_env.simulation.state import PERSON_RADIUS

CAPTION_HEIGHT = 28  # [px], the strip below the floor
_CAPTION_GROUND: RGB = (38, 44, 52)
_CAPTION_INK: RGB = (236, 238, 240)
_CAPTION_DIM: RGB = (168, 176, 186)
_NUMBERS_FROM = 32  # [px/m] from which robots show their number
SHOWN = 60.0  # [m] of a route ahead of its robot
_HAIR, _FINEST = 0.35, 2.0  # [px], half the width of a route that one line shows; between two of its points


class Scene(NamedTuple):
    """What a picture shows of one world with N robots."""

    grid: GridMap
    bodies: Sequence[RobotSpec]  # [N]
    pose: NDArray[np.float32]  # [N, 3] front axle x [m], y [m], heading [rad]
    goal: NDArray[np.int64]  # [N, 2] cells
    routes: list[NDArray[np.float32]]  # N x [R, 2], way-points ahead [m]
    touching: NDArray[np.bool_]  # [N]
    alive: NDArray[np.bool_]  # [N], False: parked
    time: float  # [s]
    text: str
    steer: NDArray[np.float32] | None = None  # [N], angle of the rear wheels [rad]
    waits_for: NDArray[np.int32] | None = None  # [N], the robot that each one waits for, else -1
    deadlocked: NDArray[np.bool_] | None = None  # [N], robots in a wait cycle
    goal_pose: NDArray[np.float32] | None = None  # [N, 3] poses at goals: front axle x, y [m], heading (nan: any)
    loaded: NDArray[np.bool_] | None = None  # [N], robots that carry something
    people: NDArray[np.float32] | None = None  # [M, 3], x [m], y [m], walking direction [rad]


def scene_of(simulator: Any, world: int = 0) -> Scene:
    """Copy what a picture of one world of a Simulator needs."""
    state = simulator.state
    counts = state.route_points[world]
    routes = [
        route_ahead(simulator.routes[world, i, : int(count)], float(state.route_position[world, i]))
        for i, count in enumerate(counts)
    ]
    jams, shifts = simulator.jams(), simulator.dispatcher.shifts
    goals, collisions, _ = totals_of(simulator.robots[world])
    parts = [simulator.grid.name, counted(len(counts), "robot"), counted(goals, "goal")]
    parts.append(counted(collisions, "collision"))
    return Scene(
        grid=simulator.grid, bodies=simulator.config.robots, pose=np.array(state.pose[world]),
        goal=np.array(state.goal[world], dtype=np.int64), routes=routes,
        touching=np.array(simulator.events.touching[world], dtype=np.bool_),
        alive=np.array(state.alive[world], dtype=np.bool_) if shifts is None else shifts[world].at_work(),
        time=float(simulator.seconds(world)), text="   ".join(parts), steer=np.array(state.steer[world]),
        waits_for=jams.waits_for[world], deadlocked=jams.cycle[world] >= 0, goal_pose=goal_poses(simulator, world),
        loaded=None if shifts is None else shifts[world].carries.copy(), people=places(simulator.people.persons[world]),
    )  # fmt: skip


def route_ahead(route: NDArray[np.float32], driven: float) -> NDArray[np.float32]:
    """Return the visible part of a route[R, 2] [m] after `driven` metres -> float32[K, 2], K <= R."""
    if len(route) < 2:
        return np.array(route, dtype=np.float32).reshape(-1, 2)
    step = np.hypot(*np.diff(route.astype(np.float64), axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(step)])
    driven = min(max(driven, 0.0), float(along[-1]))
    here = [np.interp(driven, along, route[:, axis]) for axis in (0, 1)]
    return np.concatenate([[here], route[(along > driven) & (along <= driven + SHOWN)]]).astype(np.float32)


def draw(scene: Scene, pixels_per_metre: float = 16) -> NDArray[np.uint8]:
    """Draw a scene -> uint8[H, W, 3], north at the top, a caption strip of CAPTION_HEIGHT below the floor.

    Raises ConfigError for a scale that is no number above 0, WarehouseError if pygame is missing.
    """
    scale = float(pixels_per_metre)
    if not (math.isfinite(scale) and scale > 0):
        raise ConfigError(f"pixels_per_metre={pixels_per_metre!r} must be a finite number above 0")
    pygame = load("pygame")
    # 32 bits a pixel, since pygame's smooth lines misread 24; a canvas shares its array's memory.
    ground = _ground(scene.grid, scale).copy()
    height, columns, _ = ground.shape
    rows = height - CAPTION_HEIGHT
    canvas = pygame.image.frombuffer(ground, (columns, height), "RGBX")
    canvas.set_clip((0, 0, columns, rows))
    top = scene.grid.shape[0] * scene.grid.cell_size
    _draw_routes(pygame, canvas, scene, top, scale)
    _draw_goals(pygame, canvas, scene, top, scale)
    _draw_robots(pygame, canvas, scene, top, scale)
    _draw_people(pygame, canvas, scene, top, scale)
    _draw_waiting(pygame, canvas, scene, top, scale)
    canvas.set_clip(None)
    _draw_caption(pygame, canvas, scene, rows)
    frame = np.empty((height, columns, 3), dtype=np.uint8)
    pygame.image.frombuffer(frame, (columns, height), "RGB").blit(canvas, (0, 0))
    return frame


@lru_cache(maxsize=4)
def _ground(grid: GridMap, scale: float) -> NDArray[np.uint8]:
    """Floor and empty caption strip -> uint8[H, W, 4], the fourth channel unused."""
    floor = floor_image(grid, scale)
    rows, columns, _ = floor.shape
    ground = np.zeros((rows + CAPTION_HEIGHT, columns, 4), dtype=np.uint8)
    ground[:rows, :, :3] = floor
    ground[rows:, :, :3] = _CAPTION_GROUND
    return ground


def _draw_routes(pygame: Any, canvas: Any, scene: Scene, top: float, scale: float) -> None:
    """Draw each route as several hair lines beside each other, which look like one line of even width."""
    shown = [i for i, route in enumerate(scene.routes) if len(route) > 1 and scene.alive[i]]
    if not shown:
        return
    routes = [_thinned(scene.routes[i], scale) for i in shown]
    ends = np.cumsum([len(route) for route in routes])
    way = np.concatenate(routes).astype(np.float64)
    points = np.stack([way[:, 0], top - way[:, 1]], axis=1) * scale - 0.5
    ahead = np.diff(points, axis=0, append=points[-1:])
    ahead[ends - 1] = ahead[ends - 2]  # not to where the next route begins
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1) / np.hypot(*ahead.T).clip(1e-9)[:, None]
    radius = 0.03 * scale  # [px]
    shifts = np.linspace(-radius, radius, math.ceil(1.6 * radius) + 1) if radius > _HAIR else [0.0]
    hairs = [points + shift * aside for shift in shifts]
    for i, begin, end in zip(shown, (0, *ends[:-1].tolist()), ends.tolist(), strict=True):
        for hair in hairs:
            pygame.draw.aalines(canvas, mix(robot_colour(i), FLOOR, 0.35), False, hair[begin:end].tolist())


def _thinned(route: NDArray[np.float32], scale: float) -> NDArray[np.float32]:
    """Drop points of a route[K, 2] [m] that are too close to tell apart; keep the last one."""
    apart = scale * float(np.hypot(*(route[-1] - route[-2])))  # [px]
    every = int(_FINEST / max(apart, 1e-9))
    return route if every < 2 else np.concatenate([route[:-1:every], route[-1:]])


def _draw_goals(pygame: Any, canvas: Any, scene: Scene, top: float, scale: float) -> None:
    centres = scene.grid.centre(np.asarray(scene.goal)).reshape(-1, 2)
    poses = [(x, y, math.nan) for x, y in centres.tolist()] if scene.goal_pose is None else scene.goal_pose.tolist()
    for i in np.flatnonzero(scene.alive).tolist():
        x, y, heading = poses[i]
        sprites.stamp_goal(pygame, canvas, (x * scale, (top - y) * scale), robot_colour(i), scale, heading)


def _draw_robots(pygame: Any, canvas: Any, scene: Scene, top: float, scale: float) -> None:
    # Parked robots first and those in contact last, so that what matters lies on top.
    for i in np.lexsort((scene.touching, scene.alive)):
        robot = scene.bodies[i]
        reach = math.hypot(robot.length, robot.width) / 2 + 0.25  # with halo and shadow
        centre = sprites.body_centre(scene.pose[i], robot)
        tile = sprites.Tile(pygame, centre, reach, top, scale)
        steer = 0.0 if scene.steer is None else float(scene.steer[i])
        rim = CONTACT if scene.touching[i] else _waiting_colour(scene, int(i))
        sprites.paint_robot(tile, scene.pose[i], steer, robot, robot_colour(int(i)), rim, bool(scene.alive[i]))
        if scene.loaded is not None and scene.loaded[i]:
            sprites.paint_load(tile, scene.pose[i], robot)
        tile.stamp(canvas)
        if scale >= _NUMBERS_FROM:
            x, y = sprites.plate_centre(scene.pose[i], robot)
            number = _font(pygame, round(0.24 * scale)).render(str(i), True, (20, 24, 30))
            canvas.blit(number, number.get_rect(center=(x * scale, (top - y) * scale)))


def _draw_people(pygame: Any, canvas: Any, scene: Scene, top: float, scale: float) -> None:
    for x, y, heading in [] if scene.people is None else scene.people.tolist():
        tile = sprites.Tile(pygame, (x, y), 2 * PERSON_RADIUS, top, scale)
        sprites.paint_person(tile, (x, y), heading)
        tile.stamp(canvas)


def _waiting_colour(scene: Scene, robot: int) -> RGB | None:
    """Return the mark of a waiting robot; None for one that does not wait."""
    if scene.waits_for is None or scene.waits_for[robot] < 0:
        return None
    return DEADLOCK if scene.deadlocked is not None and scene.deadlocked[robot] else WAITING


def _draw_waiting(pygame: Any, canvas: Any, scene: Scene, top: float, scale: float) -> None:
    """Draw an arrow from each waiting robot to the one it waits for; those of a wait cycle are thicker, and on top."""
    inks = {i: ink for i in range(len(scene.pose)) if (ink := _waiting_colour(scene, i)) is not None}
    width = max(0.07, 1.6 / scale)  # [m], a pixel and a half at least
    for i in sorted(inks, key=lambda i: inks[i] == DEADLOCK):
        begin, end = (np.array(sprites.body_centre(scene.pose[k], scene.bodies[k])) for k in (i, scene.waits_for[i]))  # type: ignore[index]
        middle, reach = (begin + end) / 2, float(np.hypot(*(end - begin))) / 2 + 6 * width
        tile = sprites.Tile(pygame, (float(middle[0]), float(middle[1])), reach, top, scale)
        stuck = inks[i] == DEADLOCK
        sprites.paint_arrow(tile, begin, end, DEADLOCK if stuck else _CAPTION_GROUND, width * (1.5 if stuck else 1.0))
        tile.stamp(canvas)


def _draw_caption(pygame: Any, canvas: Any, scene: Scene, upper: int) -> None:
    """Write the time at the right and the text at the left, cut short if it does not fit."""
    font = _font(pygame, 13)
    width = canvas.get_width()
    clock = font.render(f"{scene.time:.1f} s", True, _CAPTION_DIM)
    room = width - clock.get_width() - 36
    text = scene.text
    while text and font.size(text)[0] > room:
        text = text[:-2].rstrip() + "…" if len(text) > 2 else ""
    for image, left in ((font.render(text, True, _CAPTION_INK), 12), (clock, width - clock.get_width() - 12)):
        canvas.blit(image, (left, upper + (CAPTION_HEIGHT - image.get_height()) // 2))


@lru_cache(maxsize=8)
def _font(pygame: Any, size: int) -> Any:
    """Return the typeface that matplotlib ships, where it is installed, else pygame's own; size in px."""
    pygame.font.init()
    found = importlib.util.find_spec("matplotlib")
    if found is not None and found.origin:
        file = Path(found.origin).parent / "mpl-data" / "fonts" / "ttf" / "DejaVuSans.ttf"
        if file.is_file():
            return pygame.font.Font(str(file), size)
    return pygame.font.Font(None, round(size * 1.4))
