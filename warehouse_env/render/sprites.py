"""Small anti-aliased shapes: each is painted large on its own tile, then shrunk onto the frame."""

import math
from collections.abc import Iterable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import RobotSpec
from warehouse_env.render.colours import GREY, ORANGE, RGB, mix
from warehouse_env.simulation.state import PERSON_RADIUS

Points = NDArray[np.float64]

_OVERSAMPLE = 4
_WHITE: RGB = (255, 255, 255)
_WHEEL: RGB = (28, 31, 36)
_CRATE: RGB = (196, 154, 96)
_VEST_EDGE: RGB = (43, 32, 6)
_WHEELS_FROM = 11.0  # [px/m]
_NOSE, _PLATE_FRONT, _PLATE_GAP = 0.32, 0.41, 0.10  # [m] behind the front: of the nose, of the plate; off the tail
_SHADOW = (0.05, -0.06)  # [m] to the south-east
_CORNER_STEPS = np.linspace(0.0, math.pi / 2, 5)


class Tile:
    """A square of transparent ground around a point, painted in metres, `_OVERSAMPLE` times too large."""

    def __init__(self, pygame: Any, centre: tuple[float, float], reach: float, top: float, scale: float) -> None:
        """Cover `reach` [m] around `centre` [m]; `top` [m] is the floor's north edge, `scale` [px/m] the frame's."""
        self._pygame = pygame
        self.scale = scale
        x, y = centre[0] * scale, (top - centre[1]) * scale
        side = 2 * math.ceil(reach * scale) + 2
        self.left, self.upper = math.floor(x) - side // 2, math.floor(y) - side // 2
        # The metre origin in the tile's large pixels, less the half that pygame's rounding adds.
        self._corner = (-self.left * _OVERSAMPLE - 0.5, (top * scale - self.upper) * _OVERSAMPLE - 0.5)
        self.surface = pygame.Surface((side * _OVERSAMPLE, side * _OVERSAMPLE), pygame.SRCALPHA, 32)

    def polygon(self, points: Points, colour: RGB, alpha: int = 255) -> None:
        """Fill a polygon, points float[K, 2] in metres."""
        self.polygons(points, [(0, len(points), colour, alpha)])

    def circle(self, centre: tuple[float, float], radius: float, colour: RGB, alpha: int = 255) -> None:
        """Fill a circle, in metres."""
        fine = self.scale * _OVERSAMPLE
        place = (centre[0] * fine + self._corner[0], -centre[1] * fine + self._corner[1])
        self._pygame.draw.circle(self.surface, _ink(colour, alpha), place, radius * fine)

    def polygons(self, points: Points, shapes: Iterable[tuple[int, int, RGB, int]]) -> None:
        """Fill polygons, each from one of float[K, 2] points [m] to before another, with a colour and an alpha."""
        fine = self.scale * _OVERSAMPLE
        pixels = (points * (fine, -fine) + self._corner).tolist()
        for begin, end, colour, alpha in shapes:
            self._pygame.draw.polygon(self.surface, _ink(colour, alpha), pixels[begin:end])

    def shrunk(self) -> Any:
        """Return the tile at the frame's size; shapes on transparent black, so already multiplied by their cover."""
        side = self.surface.get_width() // _OVERSAMPLE
        return self._pygame.transform.smoothscale(self.surface, (side, side))

    def stamp(self, canvas: Any) -> None:
        """Shrink the tile and lay it over the frame's surface."""
        canvas.blit(self.shrunk(), (self.left, self.upper), special_flags=self._pygame.BLEND_PREMULTIPLIED)


@lru_cache(maxsize=256)
def _ink(colour: RGB, alpha: int) -> tuple[int, int, int, int]:
    red, green, blue = (channel * alpha // 255 for channel in colour)
    return red, green, blue, alpha


@lru_cache(maxsize=64)
def rounded_box(rear: float, front: float, right: float, left: float, corner: float) -> Points:
    """Outline of a rectangle with round corners: x ahead from rear to front, y to the left, in metres."""
    corner = min(corner, (front - rear) / 2, (left - right) / 2)
    arc = np.stack([np.cos(_CORNER_STEPS), np.sin(_CORNER_STEPS)], axis=1) * corner
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])  # turns by 90 degrees
    centres = [(front - corner, left - corner), (rear + corner, left - corner)]
    centres += [(rear + corner, right + corner), (front - corner, right + corner)]
    parts = []
    for centre in centres:
        parts.append(arc + centre)
        arc = arc @ quarter.T
    return np.concatenate(parts)


def body_centre(pose: NDArray[np.float32], robot: RobotSpec) -> tuple[float, float]:
    """Centre [m] of the body whose front axle stands at pose (x, y, heading)."""
    x, y, heading = (float(value) for value in pose)
    back = robot.rear_reach - robot.length / 2
    return x - back * math.cos(heading), y - back * math.sin(heading)


def plate_centre(pose: NDArray[np.float32], robot: RobotSpec) -> tuple[float, float]:
    """Centre [m] of the lighter plate behind the front mark, where a number fits."""
    x, y, heading = (float(value) for value in pose)
    back = (robot.rear_reach - robot.front_overhang + _PLATE_FRONT - _PLATE_GAP) / 2
    return x - back * math.cos(heading), y - back * math.sin(heading)


def paint_robot(
    tile: Tile, pose: NDArray[np.float32], steer: float, robot: RobotSpec, colour: RGB, rim: RGB | None, alive: bool
) -> None:
    """Paint one robot: pose (x [m], y [m], heading [rad]) of the front axle, steer [rad] of the rear wheels.

    rim: colour of a mark (contact, waiting), None: the robot's own. Small pictures omit the wheels, so that the colour
    stays visible.
    """
    detailed = tile.scale >= _WHEELS_FROM
    x, y, heading = (float(value) for value in pose)
    still, ends = _outlines(robot, rim is not None)
    turned = [_steered_wheels(robot, steer)] if detailed else []
    points = np.concatenate([still, *turned]) @ _rotation(heading) + (x, y)
    points[ends[0] : ends[1]] += _SHADOW
    if not alive:
        colour = mix(GREY, _WHITE, 0.25)
    wheel = mix(_WHEEL, _WHITE, 0.0 if alive else 0.35)
    inks = [(rim or colour, 90), ((20, 24, 30), 70), (rim or mix(colour, (0, 0, 0), 0.4), 255), (colour, 255)]
    inks += [(wheel, 255), (wheel, 255), (mix(colour, _WHITE, 0.5), 255), (_WHITE if alive else (225, 227, 230), 255)]
    shapes = [(begin, end, *ink) for begin, end, ink in zip((0, *ends), ends, inks, strict=False)]
    begin = 0 if rim is not None else 1  # the halo
    if not detailed:
        tile.polygons(points, [*shapes[begin:4], shapes[7]])
        return
    middle = (len(still) + len(points)) // 2
    steered = [(len(still), middle, wheel, 255), (middle, len(points), wheel, 255)]
    tile.polygons(points, [*shapes[begin:6], *steered, *shapes[6:]])


def paint_load(tile: Tile, pose: NDArray[np.float32], robot: RobotSpec) -> None:
    """Paint a crate on a robot whose front axle stands at pose (x [m], y [m], heading [rad])."""
    x, y, heading = (float(value) for value in pose)
    half, back = robot.width / 2 - 0.12, 0.12 - robot.rear_reach
    edges = [rounded_box(back + s, back + 0.45 * robot.length - s, s - half, half - s, 0.02) for s in (0.0, 0.03)]
    points = np.concatenate(edges) @ _rotation(heading) + (x, y)
    cut = len(edges[0])
    tile.polygons(points, [(0, cut, mix(_CRATE, (0, 0, 0), 0.45), 255), (cut, len(points), _CRATE, 255)])


@lru_cache(maxsize=16)
def _outlines(robot: RobotSpec, marked: bool) -> tuple[Points, tuple[int, ...]]:
    """Return the outlines of a body [m], one after the other, and where each ends.

    Halo, shadow, hull, skin, the two fixed wheels, plate, nose.
    """

    def hull(inset: float, corner: float) -> Points:
        half = robot.width / 2 - inset
        return rounded_box(inset - robot.rear_reach, robot.front_overhang - inset, -half, half, corner)

    half, front, side = robot.width / 2 - 0.13, robot.front_overhang, robot.width / 2 - 0.09
    plate = rounded_box(_PLATE_GAP - robot.rear_reach, front - _PLATE_FRONT, -half, half, 0.05)
    nose = np.array([(front - 0.05, 0.0), (front - _NOSE, half + 0.03), (front - _NOSE, -half - 0.03)])
    skin = hull(0.07 if marked else 0.05, 0.08)
    left, right = (_wheel() + np.array([0.0, aside]) for aside in (side, -side))
    shapes = [hull(-0.22, 0.3), hull(0.0, 0.12), hull(0.0, 0.12), skin, left, right, plate, nose]
    return np.concatenate(shapes), tuple(np.cumsum([len(shape) for shape in shapes]).tolist())


def _wheel() -> Points:
    return rounded_box(-0.11, 0.11, -0.05, 0.05, 0.03)


def _steered_wheels(robot: RobotSpec, steer: float) -> Points:
    """Outlines of the wheels on the body's other axle; ahead of the fixed one, an angle counts the other way."""
    axle, angle = (robot.wheelbase, -steer) if robot.front_steered else (-robot.wheelbase, steer)
    turned, side = _wheel() @ _rotation(angle), robot.width / 2 - 0.09
    return np.concatenate([turned + np.array([axle, aside]) for aside in (side, -side)])


def _rotation(angle: float) -> Points:
    """Matrix that turns row vectors by `angle` [rad], counter-clockwise."""
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[cos, sin], [-sin, cos]])


def paint_person(tile: Tile, place: tuple[float, float], heading: float) -> None:
    """Paint a person from above: shoulders in a vest across the way that it walks [rad], and a helmet."""
    x, y = place
    angles = np.linspace(0.0, 2 * np.pi, 25)[:-1]
    for ink, along, across in ((_VEST_EDGE, 0.19, PERSON_RADIUS), (ORANGE, 0.15, PERSON_RADIUS - 0.04)):
        outline = np.stack([along * np.cos(angles), across * np.sin(angles)], axis=1)
        tile.polygon(outline @ _rotation(heading) + (x, y), ink)
    tile.circle((x, y), 0.12, _VEST_EDGE)
    tile.circle((x, y), 0.09, _WHITE)


def stamp_goal(
    pygame: Any, canvas: Any, centre: tuple[float, float], colour: RGB, scale: float, heading: float = math.nan
) -> None:
    """Draw a target of the robot's colour around a place of the frame's surface [px]; `scale` [px/m].

    heading [rad]: the robot's heading there, nan: any.
    """
    left, upper = math.floor(centre[0]), math.floor(centre[1])
    parts = (math.floor((value - math.floor(value)) * _OVERSAMPLE) for value in centre)
    turn = None if math.isnan(heading) else round(heading / _NOSE_STEP) * _NOSE_STEP
    picture, x, y = _goal(pygame, colour, scale, *parts, turn)
    canvas.blit(picture, (left + x, upper + y), special_flags=pygame.BLEND_PREMULTIPLIED)


_NOSE_STEP = math.pi / 36  # [rad]


@lru_cache(maxsize=512)
def _goal(pygame: Any, colour: RGB, scale: float, right: int, down: int, turn: float | None) -> tuple[Any, int, int]:
    """Return a target around a point that many `_OVERSAMPLE`ths of a pixel off, and where its corner lies [px].

    turn [rad]: which way its nose points, None: it has none.
    """
    x, y = right / _OVERSAMPLE / scale, -down / _OVERSAMPLE / scale
    tile = Tile(pygame, (x, y), 0.45 if turn is None else 0.75, 0.0, scale)
    if turn is not None:
        for tip, side, ink in ((0.72, 0.30, _WHITE), (0.66, 0.24, colour)):
            tile.polygon(np.array([[tip, 0.0], [0.2, side], [0.2, -side]]) @ _rotation(turn) + (x, y), ink)
    for radius, ink, alpha in ((0.40, _WHITE, 200), (0.36, colour, 255), (0.26, _WHITE, 235), (0.13, colour, 255)):
        tile.circle((x, y), radius, ink, alpha)
    return tile.shrunk(), tile.left, tile.upper


def paint_arrow(tile: Tile, begin: Points, end: Points, ink: RGB, width: float) -> None:
    """Paint an arrow from begin to end float[2] [m], its shaft `width` [m] wide, on a white edge.

    It lies half a head's width to its own left, so that two that point at each other's tails are both seen.
    """
    ahead = (end - begin) / max(float(np.hypot(*(end - begin))), 1e-6)
    left = np.array([-ahead[1], ahead[0]])
    for edge, colour in ((0.04, _WHITE), (0.0, ink)):
        half, head = width / 2 + edge, 1.6 * width + edge
        neck = end - 2.4 * width * ahead
        tip, tail = end + 2 * edge * ahead, begin - edge * ahead
        outline = [tail - half * left, neck - half * left, neck - edge * ahead - head * left, tip]
        outline += [neck - edge * ahead + head * left, neck + half * left, tail + half * left]
        tile.polygon(np.array(outline) + 1.6 * width * left, colour)
