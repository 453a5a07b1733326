"""Where right of way steps in: everywhere, or only around robots that have stood for `right_of_way_after` seconds.

A policy that gives way by itself drives closer, and gets farther, than by the stretches that rules grant; but now and
then some of its robots bar each other's way for good. There the rules hold: around a ring of robots each of which waits
for the next (jams.py), since no ring dissolves by itself, and around who has stood five times as long for whatever
reason. Who stands in a queue needs no rules, only patience. They hold a metre around it for each second that it has
stood, so wider where they have not helped, and until nobody near has called for them for a while. The others drive as
commanded: what they are granted of their paths is what the settled ones expect of them.

Measured on trial seeds with one trained policy, late goals per robot and hour of 600 s. Without right of way 27% of 64
robots on six generated floors were stuck at the end and 82 goals reached; 4 m around all that had stood for 6 s, 98 and
at most 2%. Beside that, around rings after 3 s and others after 15 s, a metre a second up to 8 m: 105 to 111 instead of
98 to 100 on `paper46` at 128, 137 instead of 134 at 64; 107, 103 instead of 98, 99 on generated floors at 64, up to 5
less on two others; at 128 on `narrow` and generated floors 48 and 49 instead of 50 and 46. Rings alone within 4 m gain
more where floors are not crowded (114 on `paper46` at 128) and lose most of what they can where they are (43 on
`narrow`, 16 to 24 instead of 25 to 30 on one generated floor); 6 m around and calm for 20 s: as for all that had stood.

A policy trained four times as long needs them later. Around rings after 3, 8, 12 and 20 s, others after five times
that, with 128 robots: 98, 112, 120, 123 on `paper46`, 47, 32, 47, 60 on `narrow`, 49, 52, 47, 52 on `single_lane`, and
39, 42, 45, 38 on three generated floors, where 17, 7, 9 and 22% of the robots were stuck at the end.
"""

from __future__ import annotations

import numpy as np

from warehouse_env.kernel import part
from warehouse_env.simulation.physics.trigonometry import ONE, ZERO
from warehouse_env.simulation.rules.jams import waits_for
from warehouse_env.simulation.state import NOBODY

SPREAD = np.float32(1.0)  # [m/s] of standing around one that calls for the rules, within which robots are settled ...
AROUND = np.float32(8.0)  # [m] ... and this far at most
CALM = np.float32(10.0)  # [s] that they stay so after nobody near has called for them
LONGER = np.float32(5.0)  # times `right_of_way_after` that a robot stands outside all rings before it calls for them
_UNASKED = -2


@part
def _in_a_ring(i, robots, routes, scratch, p):
    """Whether robot i waits for one that waits for one ... that waits for robot i; scratch[0]: whom each waits for."""
    waits, j = scratch[0], i
    for _ in range(robots.shape[0]):
        if waits[j] == _UNASKED:
            waits[j] = waits_for(robots, j, routes[j], p, scratch[1])
        j = waits[j]
        if j in (NOBODY, i):
            break
    return j == i


@part
def step_in(robots, routes, commands, scratch, p):
    """Say who is `settled`, that is keeps to what it is granted: all, or who is near one that calls for the rules.

    robots ROBOT[N] of a world; routes float32[N, R, 2] [m]; commands float32[N, 2]: speed [m/s] and lateral offset
    [m]; scratch int[2, N]. Returns whether anybody is.
    """
    after, seconds, anybody = p["right_of_way_after"], p["time_step"] * np.float32(p["repeat"]), False
    scratch[0] = _UNASKED
    for r in robots:
        r["settled"] = ONE if after == ZERO else max(r["settled"] - seconds, ZERO)
    for i in range(robots.shape[0] if after > ZERO else 0):
        stood = robots[i]["standing_time"]
        if robots[i]["alive"] == 0 or stood < after:
            continue
        if stood < LONGER * after and not _in_a_ring(i, robots, routes, scratch, p):
            continue
        around = min(SPREAD * stood, AROUND)
        for r in robots:
            dx, dy = r["x"] - robots[i]["x"], r["y"] - robots[i]["y"]
            if dx * dx + dy * dy < around * around:
                r["settled"] = CALM
    for i in range(robots.shape[0]):
        r = robots[i]
        if r["settled"] > ZERO:
            anybody = True
        else:
            r["yields_to"] = NOBODY
            if r["arcs"] == 0:
                r["aside"] = 0
            if r["side"] != commands[i, 1]:
                r["side"], r["poses"] = commands[i, 1], 0
    return anybody
