"""Zones: parts of the floor with a speed limit, which robots keep under any command.

At a point p a robot may have the speed v with v^2 = min over the zones z of (v_z^2 + 2 b |p - z|): v_z is the zone's
limit, |p - z| the distance to it (0 inside), and b a little less than full braking. Along any path v^2 falls by at most
2 b a metre. So a robot that keeps this speed can brake for any zone ahead without knowing its route. Every physics step
lowers the command to this speed, at the robot's pose now and at the step's end. A robot that is already too fast brakes
as hard as it can.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.kernel import inline
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.physics.kinematics import approach, curvature, roll
from warehouse_env.simulation.physics.trigonometry import ONE, ZERO

STEP = 0.125  # [m] between samples at most, unless the floor needs more than
_MOST = 4096  # samples along a side
_BRAKING = 0.9  # share of the full deceleration that zones are braked for with
_ABOVE = 1.1  # times the highest speed of any robot: no limit


class Zones(NamedTuple):
    """The square of the allowed speed, sampled; values between samples are interpolated."""

    squares: NDArray[np.float32]  # [H * K + 1, W * K + 1] [m^2/s^2], y up; the first sample is at (0, 0) m
    step: np.float32  # [m] between samples


def zones_of(grid: GridMap, config: EnvConfig) -> Zones | None:
    """Return the zones of a floor, None where nothing limits these robots."""
    fastest = max(max(robot.max_speed, -robot.min_speed) for robot in config.bodies)
    hardest = min(robot.max_acceleration for robot in config.bodies)  # that all can brake
    if grid.speed is None or not (grid.speed < fastest).any():
        return None
    from scipy.ndimage import distance_transform_edt  # not when this is loaded, which takes long

    slope = 2 * _BRAKING * hardest
    fine = max(1, min(math.ceil(grid.cell_size / STEP), _MOST // max(grid.shape)))
    step = grid.cell_size / fine
    rows, columns = grid.shape
    squares = np.full((rows * fine + 1, columns * fine + 1), (_ABOVE * fastest) ** 2)
    for limit in np.unique(grid.speed[grid.speed < fastest]):
        cells = np.repeat(np.repeat(grid.speed[::-1] == limit, fine, axis=0), fine, axis=1)
        outside = np.ones(squares.shape, dtype=np.bool_)
        for row in (slice(None, -1), slice(1, None)):
            for column in (slice(None, -1), slice(1, None)):  # a cell has the samples on its sides
                outside[row, column] &= ~cells
        np.minimum(squares, limit**2 + slope * step * distance_transform_edt(outside), out=squares)
    return Zones(squares.astype(np.float32), np.float32(step))


@inline
def _square_at(x, y, zones):
    """Return the square of the speed [m^2/s^2] that a robot may have at a point."""
    last_row, last_column = zones.squares.shape[0] - 2, zones.squares.shape[1] - 2
    u, v = max(x, ZERO) / zones.step, max(y, ZERO) / zones.step
    column, row = min(max(int(u), 0), last_column), min(max(int(v), 0), last_row)
    u, v = min(u - np.float32(column), ONE), min(v - np.float32(row), ONE)
    below = zones.squares[row, column] * (ONE - u) + zones.squares[row, column + 1] * u
    above = zones.squares[row + 1, column] * (ONE - u) + zones.squares[row + 1, column + 1] * u
    return below * (ONE - v) + above * v


@inline
def most_speed(r, zones, p):
    """Return the highest speed [m/s] allowed at the end of a physics step, in either direction.

    zones: None where the floor has none.
    """
    motion = r["motion"]
    if zones is None:
        return np.float32(np.inf)
    way, bend = motion["speed"] * p["time_step"], curvature(motion["steer"], p["wheelbase"])
    x, y, _ = roll(motion["x"], motion["y"], motion["heading"], way, bend)
    return np.sqrt(min(_square_at(motion["x"], motion["y"], zones), _square_at(x, y, zones)))


@inline
def keep_under(r, acceleration, most, zones, p):
    """Return the acceleration [m/s^2] limited so that the speed stays within `most` [m/s] if braking allows."""
    motion = r["motion"]
    if zones is None:
        return acceleration
    dt = p["time_step"]
    speed = motion["speed"] + acceleration * dt
    if abs(speed) <= most:
        return acceleration
    kept = approach(motion["speed"], most if speed > ZERO else -most, p["max_acceleration"] * dt)
    return acceleration if abs(kept) >= abs(speed) else (kept - motion["speed"]) / dt
