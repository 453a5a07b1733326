"""One robot as a vehicle of VDA 5050: its orders, base and horizon, and what it says of itself, moment by moment."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from train.fleet.story import Story
from train.fleet.ways import Node, Order, orders_of
from warehouse_env.simulation.state import NOBODY

Body = tuple[str, dict[str, Any]]
"""Name of a topic, and what a message of it says below its header."""

AHEAD = 6.0  # [m] of the way that are in the base when it is lengthened, which is done when half of it is left
STATE_EVERY = 30.0  # [s] between two states at the most
CONTACTS = ("contactRobot", "contactShelf", "contactPerson")
"""Types of the errors that a vehicle reports while it touches something."""
_HITS = ("hit_robot", "hit_shelf", "hit_person")
_MOVES = 0.01  # [m/s] from which a vehicle drives
_PASSED = 1e-3  # [m]
_HALF_TURN = 3.1415  # [rad], not more than pi with so many digits


def serial_of(robot: int) -> str:
    """Return the serial number of a robot, counted from 0; in the order of texts they stand in the robots' order."""
    return f"{robot:05d}"


class _Sent(NamedTuple):
    """What makes a vehicle say its state at once when it changes."""

    order: str
    update: int
    passed: int
    driving: bool
    loaded: bool
    errors: tuple[str, ...]
    action: str | None
    charging: bool


class Vehicle:
    """A robot of a story; `at` is to be asked for every moment, one after the other."""

    def __init__(self, story: Story, robot: int) -> None:
        self._story, self._robot, self.serial = story, robot, serial_of(robot)
        self._orders = orders_of(story, robot)
        config = story.replay.config
        self._map = story.replay.grid.name
        self._aside = max(map(abs, config.lateral_offsets)) + config.arrival_radius  # [m] beside its route, at the most
        flags = {name: story.flag(name)[:, robot] for name in ("loaded", "touching", *_HITS)}
        self._loaded, self._touching = flags["loaded"], flags["touching"]
        self._hits = [flags[name] for name in _HITS]
        self._number, self._update, self._way = -1, 0, 0  # of the order that it has, its last update, the way in it
        self._base: list[Node] = []  # of this order
        self._horizon: list[Node] = []
        self._sure = 0  # of the horizon's nodes may come into the base
        self._passed = 0  # nodes of the base
        self._reached = False
        self._action: str | None = None
        self._farthest = 0.0  # [m] along its way
        self._contacts: dict[str, None] = {}
        self._loads = 0
        self._said: _Sent | None = None
        self._said_at = -math.inf  # [s]

    def at(self, frame: int) -> Iterator[Body]:
        """Yield what it is ordered and what it says at a moment, which its orders come before."""
        if frame == 0 or (self._loaded[frame] and not self._loaded[frame - 1]):
            self._loads += bool(self._loaded[frame])
        self._feel(frame)
        coming = self._orders[self._number + 1] if self._number + 1 < len(self._orders) else None
        yield from self._drive(frame)
        if coming is not None and coming.begin == frame:
            if self._number >= 0:
                yield from self._say(frame)  # that it is done
            self._begin(coming)
            yield "order", self._order(0)
        elif self._number >= 0 and not self._reached:
            yield from self._go_on(frame)
        yield from self._say(frame)

    def _feel(self, frame: int) -> None:
        if not self._touching[frame]:
            self._contacts.clear()
        for name, hits in zip(CONTACTS, self._hits, strict=True):
            if hits[frame] and self._touching[frame]:
                self._contacts[name] = None

    def _drive(self, frame: int) -> Iterator[Body]:
        """Pass nodes, and reach the goal; where it lies beside a longer way, that is cleared first."""
        if self._number < 0:
            return
        order = self._orders[self._number]
        if frame == order.reached:
            stitch, cleared = len(self._base) - 1, bool(self._horizon)
            self._base += self._horizon
            self._horizon, self._passed, self._reached = [], len(self._base), True
            self._update += cleared
            if cleared:
                yield "order", self._order(stitch)
        if self._reached:
            self._action = order.work and ("RUNNING" if self._story.serving[frame, self._robot] else "FINISHED")
            return
        way = order.ways[self._way]
        if frame >= way.end:
            return
        self._farthest = max(self._farthest, float(self._story.replay.along[frame, self._robot]))
        last = len(self._base) - (not self._horizon and way.end == order.reached)  # the goal is reached, not passed
        while self._passed < last and self._base[self._passed].along <= self._farthest + _PASSED:
            self._passed += 1

    def _begin(self, order: Order) -> None:
        """Take the next order: its first node is where the vehicle is."""
        self._number, self._update, self._way = self._number + 1, 0, 0
        self._base, self._passed, self._reached = [order.start], 1, False
        self._action = order.work and "WAITING"
        self._take_way(order)
        self._lengthen()

    def _take_way(self, order: Order) -> None:
        way = order.ways[self._way]
        self._horizon, self._sure, self._farthest = list(way.nodes), way.sure, 0.0

    def _go_on(self, frame: int) -> Iterator[Body]:
        """Update the order where the route is another one, or the base soon comes to its end."""
        order, stitch = self._orders[self._number], len(self._base) - 1
        if self._way + 1 < len(order.ways) and order.ways[self._way + 1].begin == frame:
            self._passed = len(self._base)
            self._way += 1
            self._take_way(order)
            self._lengthen()
        else:
            left = self._base[-1].along - self._farthest if stitch >= self._passed else 0.0
            if not self._sure or left > AHEAD / 2:
                return
            self._lengthen()
        self._update += 1
        yield "order", self._order(stitch)

    def _lengthen(self) -> None:
        """Move nodes from the horizon into the base: one, and those that lie near enough."""
        count = sum(node.along <= self._farthest + AHEAD for node in self._horizon[: self._sure])
        count = max(count, min(1, self._sure))
        self._base += self._horizon[:count]
        self._horizon, self._sure = self._horizon[count:], self._sure - count

    @property
    def _id(self) -> str:
        return f"{self.serial}-{self._number + 1}" if self._number >= 0 else ""

    def _name(self, node: Node) -> str:
        return f"{node.x:.3f},{node.y:.3f}"

    def _node(self, nodes: list[Node], k: int) -> dict[str, Any]:
        """Return what order and state say of a node."""
        node = nodes[k]
        position = {"x": node.x, "y": node.y, "mapId": self._map}
        return {
            "nodeId": self._name(node), "sequenceId": 2 * k, "released": k < len(self._base), "nodePosition": position,
        }  # fmt: skip

    def _order(self, stitch: int) -> dict[str, Any]:
        """Return the order from node number `stitch` on."""
        order, nodes = self._orders[self._number], self._base + self._horizon
        listed = [self._node(nodes, k) | {"actions": []} for k in range(stitch, len(nodes))]
        for node in listed:
            node["nodePosition"]["allowedDeviationXY"] = self._aside
        if order.work is not None:
            listed[-1]["nodeDescription"] = order.goal
            kind = {"actionType": order.work, "actionId": self._id, "blockingType": "HARD"}
            listed[-1]["actions"] = [kind]
        edges = [self._edge(nodes, k) for k in range(stitch, len(nodes) - 1)]
        return {"orderId": self._id, "orderUpdateId": self._update, "nodes": listed, "edges": edges}

    def _edge(self, nodes: list[Node], k: int) -> dict[str, Any]:
        """Return the edge behind a node, with its path where that is not straight."""
        first, last = nodes[k], nodes[k + 1]
        length = float(np.hypot(*np.diff(last.path, axis=0).T).sum())
        edge = {
            "edgeId": f"{self._name(first)}>{self._name(last)}", "sequenceId": 2 * k + 1,
            "released": k + 1 < len(self._base), "startNodeId": self._name(first), "endNodeId": self._name(last),
            "maxSpeed": self._story.replay.config.robot.max_speed, "length": round(length, 3), "actions": [],
        }  # fmt: skip
        if len(last.path) > 2:
            inner = np.linspace(0.0, 1.0, len(last.path)).round(6).tolist()
            points = [{"x": x, "y": y} for x, y in last.path.tolist()]
            edge["trajectory"] = {"degree": 1, "knotVector": [0.0, *inner, 1.0], "controlPoints": points}
        return edge

    def _say(self, frame: int) -> Iterator[Body]:
        """Yield the state where it has changed, or was last said long ago."""
        story, robot = self._story, self._robot
        driving = abs(float(story.replay.speed[frame, robot])) > _MOVES
        now = _Sent(
            self._id, self._update, self._passed, driving, bool(self._loaded[frame]), tuple(self._contacts),
            self._action, bool(story.charging[frame, robot]),
        )  # fmt: skip
        seconds = frame * story.replay.seconds
        if now != self._said or seconds + story.replay.seconds > self._said_at + STATE_EVERY:
            self._said, self._said_at = now, seconds
            yield "state", self._state(frame, now)

    def _state(self, frame: int, now: _Sent) -> dict[str, Any]:
        """Return the whole state."""
        story, robot, nodes = self._story, self._robot, self._base + self._horizon
        passed = self._passed
        edges = [
            {"edgeId": f"{self._name(nodes[k])}>{self._name(nodes[k + 1])}", "sequenceId": 2 * k + 1,
             "released": k + 1 < len(self._base)}
            for k in range(max(passed - 1, 0), len(nodes) - 1)
        ]  # fmt: skip
        load = {"loadId": f"{self.serial}-{self._loads}", "loadType": "goods"}
        waits = int(story.replay.waits_for[frame, robot])
        told = {"infoType": "waitsFor", "infoLevel": "INFO", "infoReferences": [
            {"referenceKey": "serialNumber", "referenceValue": serial_of(waits)}]}  # fmt: skip
        work = self._orders[self._number].work if self._number >= 0 else None
        action = {"actionId": self._id, "actionType": work, "actionStatus": now.action}
        return {
            "orderId": now.order, "orderUpdateId": now.update,
            "lastNodeId": self._name(nodes[passed - 1]) if passed else "",
            "lastNodeSequenceId": 2 * (passed - 1) if passed else 0,
            "nodeStates": [self._node(nodes, k) for k in range(passed, len(nodes))], "edgeStates": edges,
            "driving": now.driving, "operatingMode": "AUTOMATIC", **self.where(frame),
            "loads": [load] if now.loaded else [], "actionStates": [action] if work else [],
            "batteryState": {
                "batteryCharge": round(100 * float(story.charge[frame, robot]), 1), "charging": now.charging,
            },
            "errors": [{"errorType": name, "errorLevel": "WARNING"} for name in now.errors],
            "information": [told] if waits != NOBODY else [],
            "safetyState": {"eStop": "NONE", "fieldViolation": bool(story.replay.held_by[frame, robot] != NOBODY)},
        }  # fmt: skip

    def where(self, frame: int) -> dict[str, Any]:
        """Return position and velocity, as state and visualization have them."""
        replay, robot = self._story.replay, self._robot
        pose, speed = replay.pose[frame, robot].astype(float), float(replay.speed[frame, robot])
        x, y = replay.grid.world(pose).round(3).tolist()
        theta = math.remainder(float(pose[2]), math.tau)
        turn = -speed * math.tan(float(replay.steer[frame, robot])) / replay.config.robot.wheelbase
        turn = -turn if replay.config.robot.front_steered else turn
        velocity = {"vx": round(speed, 3), "vy": 0.0, "omega": round(turn, 4)}
        position = {
            "x": x,
            "y": y,
            "theta": min(max(round(theta, 4), -_HALF_TURN), _HALF_TURN),
            "mapId": self._map,
            "positionInitialized": True,
        }
        return {"agvPosition": position, "velocity": velocity}
