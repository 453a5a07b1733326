"""Fixed work as a Numba kernel, for machines without a C compiler: motion, and rays against the other robots' bodies.

Change nothing here, and take nothing in from elsewhere: every ratio kept so far, and the release's, would no longer
compare. It is a part of what engine_step.c does, so that its ratios are not those over C, and are kept apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np

RAYS = 32
RANGE = np.float32(6.0)  # [m]
SUBSTEP, WHEELBASE = np.float32(0.05), np.float32(0.6)  # [s], [m]
FASTEST, STEEPEST = np.float32(1.5), np.float32(1.047)  # [m/s], [rad]
HALF_LENGTH, HALF_WIDTH = np.float32(0.45), np.float32(0.3)  # [m]
ZERO, ONE, TINY = np.float32(0.0), np.float32(1.0), np.float32(1e-9)

_compiled: Callable[[Callable[..., Any]], Callable[..., Any]] = numba.njit(cache=True, error_model="numpy")


@_compiled
def step(pose: Any, motion: Any, rays: Any, command: Any, seen: Any) -> None:
    """Move all robots and measure their rays; nothing stops them.

    pose float32[B, N, 3] [m], [rad] and motion float32[B, N, 2], speed [m/s] and steering [rad], are changed;
    rays float32[2, RAYS]: cosines and sines; command float32[B, N, 2] in [-1, 1]; seen float32[B, N, RAYS] [m].
    """
    worlds, robots = pose.shape[:2]
    for b in range(worlds):
        for i in range(robots):
            speed, steer = motion[b, i, 0], motion[b, i, 1]
            speed = min(max(speed + command[b, i, 0] * SUBSTEP, -FASTEST), FASTEST)
            steer = min(max(steer + command[b, i, 1] * SUBSTEP, -STEEPEST), STEEPEST)
            pose[b, i, 2] -= speed * math.tan(steer) / WHEELBASE * SUBSTEP
            pose[b, i, 0] += speed * math.cos(pose[b, i, 2]) * SUBSTEP
            pose[b, i, 1] += speed * math.sin(pose[b, i, 2]) * SUBSTEP
            motion[b, i, 0], motion[b, i, 1] = speed, steer
        for i in range(robots):
            for k in range(RAYS):
                seen[b, i, k] = RANGE
            cosine, sine = math.cos(pose[b, i, 2]), math.sin(pose[b, i, 2])
            for j in range(robots):
                if j != i:
                    _shorten(seen, rays, pose, b, i, j, cosine, sine)


@_compiled
def _shorten(seen: Any, rays: Any, pose: Any, b: int, i: int, j: int, cosine: Any, sine: Any) -> None:
    c, s = math.cos(pose[b, j, 2]), math.sin(pose[b, j, 2])
    dx, dy = pose[b, i, 0] - pose[b, j, 0], pose[b, i, 1] - pose[b, j, 1]
    along, across = dx * c + dy * s, dy * c - dx * s
    for k in range(RAYS):
        x, y = cosine * rays[0, k] - sine * rays[1, k], sine * rays[0, k] + cosine * rays[1, k]
        u, v = x * c + y * s, y * c - x * s
        u = ONE / (u if abs(u) > TINY else TINY)
        v = ONE / (v if abs(v) > TINY else TINY)
        back, front = (-HALF_LENGTH - along) * u, (HALF_LENGTH - along) * u
        right, left = (-HALF_WIDTH - across) * v, (HALF_WIDTH - across) * v
        enters, leaves = max(min(back, front), min(right, left)), min(max(back, front), max(right, left))
        if enters <= leaves and leaves > ZERO:
            seen[b, i, k] = min(seen[b, i, k], max(enters, ZERO))
