"""Whether a robot can carry out a command and then stop clear of all shelves: the path follower's test."""

import numpy as np

from warehouse_env.kernel import inline, part
from warehouse_env.simulation.driver.driving import NARROW
from warehouse_env.simulation.physics.footprint import body_touches_shelf, disc_room, sweep_is_free, touches_obstacle
from warehouse_env.simulation.physics.geometry import Pose, body_of, grown
from warehouse_env.simulation.physics.kinematics import (
    approach,
    arc_driven,
    braking,
    chassis_of,
    curvature,
    drive,
    next_motion,
    way_driven,
)
from warehouse_env.simulation.physics.stops import REST
from warehouse_env.simulation.physics.sweep import Sweep, turns_back
from warehouse_env.simulation.physics.trigonometry import HALF, ZERO, sin_cos

GRAZE = np.float32(3e-5)  # [m] that the body then keeps off shelves


@inline
def _driven(pose, way, bend):
    """Return the pose after `way` [m] on an arc of curvature `bend` [1/m]."""
    half_s, half_c = sin_cos(HALF * way * bend)
    turn_s, turn_c = sin_cos(way * bend)
    x, y = pose.x + way * (pose.c * half_c - pose.s * half_s), pose.y + way * (pose.s * half_c + pose.c * half_s)
    return Pose(x, y, pose.heading + way * bend, pose.c * turn_c - pose.s * turn_s, pose.s * turn_c + pose.c * turn_s)


@inline
def _keeps_margin(r, next_speed, next_steer, margin, p, floor):
    """Whether the body keeps `margin` [m] in a step to a speed and a steering angle, and in the stop after it.

    The step's arc is that of the mean steering (kinematics.drive), the braking path's that of the steering at its end.
    """
    motion = r["motion"]
    pose = Pose(motion["x"], motion["y"], motion["heading"], motion["cos"], motion["sin"])
    way = HALF * (motion["speed"] + next_speed) * p["time_step"]
    if next_steer != motion["steer"]:
        bend = curvature(HALF * (motion["steer"] + next_steer), p["wheelbase"])
        if not sweep_is_free(pose, bend, way, margin, p, floor):
            return False
        pose, way = _driven(pose, way, bend), ZERO
    way += HALF * next_speed * abs(next_speed) / p["max_acceleration"]
    return sweep_is_free(pose, curvature(next_steer, p["wheelbase"]), way, margin, p, floor)


@inline
def _stops_clear(r, next_speed, next_steer, p, floor):
    """Whether the body keeps GRAZE in a step to a speed and a steering angle, and in the stop after it.

    Checks every substep as contact.py does: the same poses, and the sweep between them. A robot that is too close at
    the start may leave.
    """
    motion = r["motion"]
    dt, chassis = p["dt"], chassis_of(p)
    x, y, heading, speed, steer = motion["x"], motion["y"], motion["heading"], motion["speed"], motion["steer"]
    acceleration, rate = (next_speed - speed) / p["time_step"], (next_steer - steer) / p["time_step"]
    body = grown(body_of(x, y, motion["cos"], motion["sin"], p), GRAZE)
    leaves, room = body_touches_shelf(body, floor), max(disc_room(body, floor), ZERO)
    while True:
        for _ in range(p["substeps"]):
            to_speed, to_steer = next_motion(speed, steer, acceleration, rate, chassis, dt)
            if speed != ZERO or to_speed != ZERO:
                x, y, heading = drive((x, y, heading), speed, to_speed, steer, to_steer, chassis, dt)
                s, c = sin_cos(heading)
                before, body = body, grown(body_of(x, y, c, s, p), GRAZE)
                room_before, room = room, max(disc_room(body, floor), ZERO)
                _, bend = arc_driven(speed, to_speed, steer, to_steer, chassis, dt)
                way = way_driven(speed, to_speed, bend, p["far"], dt)
                between = room_before + room <= way and not leaves
                swept = Sweep(before, body, turns_back(speed, to_speed, bend, p))
                if (between or room <= ZERO) and touches_obstacle(swept, way, between, p, floor):
                    return False
                leaves = False
            speed, steer = to_speed, to_steer
        if abs(speed) < REST:
            return True
        acceleration, rate = braking(speed, p), ZERO


@part
def may_drive(r, speed, steer, margin, p, floor):
    """Whether a robot of ROBOT may go for a speed [m/s] and a steering angle [rad] in the next physics step.

    It must be able to brake with the steering at the end of that step, and keep `margin` [m] from shelves all the way.
    A margin below NARROW is replaced by GRAZE, and checked exactly.
    """
    next_speed = approach(r["motion"]["speed"], speed, p["max_acceleration"] * p["time_step"])
    next_steer = approach(r["motion"]["steer"], steer, p["max_steer_rate"] * p["time_step"])
    if margin < NARROW:
        return _stops_clear(r, next_speed, next_steer, p, floor)
    return _keeps_margin(r, next_speed, next_steer, margin, p, floor)
