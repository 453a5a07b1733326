"""One robot as a VDA 5050 vehicle: its orders with base and horizon, and its states, moment by moment."""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from train.fleet.messages import Message, Names, Sender, factsheet_of
from train.fleet.orders import OrderNode, RobotOrder, Story, orders_of
from warehouse_env.errors import ConfigError
from warehouse_env.simulation.state import NOBODY

Body = tuple[str, dict[str, Any]]
"""Name of a topic, and a message of it without its header."""

STATE_EVERY = 30.0  # [s] between two states, at most
CONTACTS = ("contactRobot", "contactShelf", "contactPerson")
"""Error types that a vehicle reports while it touches something."""
_HITS = ("hit_robot", "hit_shelf", "hit_person")
_MOVES = 0.01  # [m/s] from which a vehicle drives
_PASSED = 1e-3  # [m]
_HALF_TURN = 3.1415  # [rad], the largest number of four decimals up to pi


def serial_of(robot: int) -> str:
    """Return the serial number of a robot, counted from 0; serial numbers sort as the robots do."""
    return f"{robot:05d}"


class _Sent(NamedTuple):
    """What is sent at once when it changes."""

    order: str
    update: int
    passed: int
    driving: bool
    loaded: bool
    errors: tuple[str, ...]
    action: str | None
    charging: bool


class VehicleWriter:
    """A robot of a story; call `at` for each moment in turn."""

    def __init__(self, story: Story, robot: int) -> None:
        self._story, self._robot, self.serial = story, robot, serial_of(robot)
        self._orders = orders_of(story, robot)
        config = story.replay.config
        self._map = story.replay.grid.name
        self._aside = max(map(abs, config.lateral_offsets)) + config.arrival_radius  # [m] beside its route, at most
        flags = ("loaded", "touching", *_HITS)
        self._loaded, self._touching, *self._hits = (story.flag(name)[:, robot] for name in flags)
        self._number, self._update, self._route = -1, 0, 0  # current order, its last update, the route within it
        self._base: list[OrderNode] = []  # of this order
        self._horizon: list[OrderNode] = []
        self._passed = 0  # nodes of the base
        self._reached = False
        self._action: str | None = None
        self._farthest = 0.0  # [m] along its route
        self._contacts: dict[str, None] = {}
        self._loads = 0
        self._said: _Sent | None = None
        self._said_at = -math.inf  # [s]

    def at(self, frame: int) -> Iterator[Body]:
        """Yield its order at a moment, if there is a new one, and then its state."""
        self._loads += bool(self._loaded[frame] and (frame == 0 or not self._loaded[frame - 1]))
        self._feel(frame)
        coming = self._orders[self._number + 1] if self._number + 1 < len(self._orders) else None
        self._drive(frame)
        if coming is not None and coming.begin == frame:
            if self._number >= 0:
                yield from self._say(frame)  # the last order is done
            self._begin(coming)
            yield "order", self._order(0)
        elif self._number >= 0 and not self._reached:
            yield from self._go_on(frame)
        yield from self._say(frame)

    def _feel(self, frame: int) -> None:
        """Keep what the robot touches."""
        if not self._touching[frame]:
            self._contacts.clear()
        for name, hits in zip(CONTACTS, self._hits, strict=True):
            if hits[frame] and self._touching[frame]:
                self._contacts[name] = None

    def _drive(self, frame: int) -> None:
        """Pass nodes, and reach the goal."""
        if self._number < 0:
            return
        order = self._orders[self._number]
        if frame == order.reached:
            self._passed, self._reached = len(self._base), True
        if self._reached:
            self._action = order.work and ("RUNNING" if self._story.serving[frame, self._robot] else "FINISHED")
            return
        route = order.routes[self._route]
        if frame >= route.end:
            return
        self._farthest = max(self._farthest, float(self._story.replay.along[frame, self._robot]))
        last = len(self._base) - (route.end == order.reached)  # the goal is reached, not passed
        while self._passed < last and self._base[self._passed].along <= self._farthest + _PASSED:
            self._passed += 1

    def _begin(self, order: RobotOrder) -> None:
        """Take the next order, which begins where the vehicle is."""
        self._number, self._update, self._base, self._passed = self._number + 1, 0, [order.start], 1
        self._reached, self._action = False, order.work and "WAITING"
        self._take_route(0)

    def _take_route(self, number: int) -> None:
        """Release the route up to where it is replaced; the rest is the horizon."""
        route = self._orders[self._number].routes[number]
        self._route, self._farthest = number, 0.0
        self._base, self._horizon = [*self._base, *route.nodes[: route.released]], list(route.nodes[route.released :])

    def _go_on(self, frame: int) -> Iterator[Body]:
        """Update the order if the route changes."""
        order, stitch = self._orders[self._number], len(self._base) - 1
        if self._route + 1 < len(order.routes) and order.routes[self._route + 1].begin == frame:
            self._passed = len(self._base)
            self._take_route(self._route + 1)
            self._update += 1
            yield "order", self._order(stitch)

    @property
    def _id(self) -> str:
        return f"{self.serial}-{self._number + 1}" if self._number >= 0 else ""

    def _name(self, node: OrderNode) -> str:
        return f"{node.x:.3f},{node.y:.3f}"

    def _node(self, nodes: list[OrderNode], k: int) -> dict[str, Any]:
        """Return a node as orders and states have it."""
        return {
            "nodeId": self._name(nodes[k]), "sequenceId": 2 * k, "released": k < len(self._base),
            "nodePosition": {"x": nodes[k].x, "y": nodes[k].y, "mapId": self._map},
        }  # fmt: skip

    def _order(self, stitch: int) -> dict[str, Any]:
        """Return the order from node number `stitch` on."""
        order, nodes = self._orders[self._number], self._base + self._horizon
        listed = [self._node(nodes, k) | {"actions": []} for k in range(stitch, len(nodes))]
        for node in listed:
            node["nodePosition"]["allowedDeviationXY"] = self._aside
        if order.work is not None:
            listed[-1]["nodeDescription"] = order.goal
            listed[-1]["actions"] = [{"actionType": order.work, "actionId": self._id, "blockingType": "HARD"}]
        edges = [self._edge(nodes, k) for k in range(stitch, len(nodes) - 1)]
        return {"orderId": self._id, "orderUpdateId": self._update, "nodes": listed, "edges": edges}

    def _edge(self, nodes: list[OrderNode], k: int) -> dict[str, Any]:
        """Return the edge after a node."""
        first, last = nodes[k], nodes[k + 1]
        return {
            "edgeId": f"{self._name(first)}>{self._name(last)}", "sequenceId": 2 * k + 1,
            "released": k + 1 < len(self._base), "startNodeId": self._name(first), "endNodeId": self._name(last),
            "maxSpeed": self._story.replay.config.robot.max_speed,
            "length": round(math.dist(first[:2], last[:2]), 3), "actions": [],
        }  # fmt: skip

    def _say(self, frame: int) -> Iterator[Body]:
        """Yield the state if it has changed, or the last one is old."""
        story, robot = self._story, self._robot
        driving = abs(float(story.replay.speed[frame, robot])) > _MOVES
        loaded, charging = bool(self._loaded[frame]), bool(story.charging[frame, robot])
        order = self._id, self._update, self._passed
        now = _Sent(*order, driving, loaded, tuple(self._contacts), self._action, charging)
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
        """Return position and velocity, as states and visualizations have them."""
        replay, robot = self._story.replay, self._robot
        pose, speed = replay.pose[frame, robot].astype(float), float(replay.speed[frame, robot])
        x, y = replay.grid.world(pose).round(3).tolist()
        theta = math.remainder(float(pose[2]) + replay.grid.yaw, math.tau)
        turn = -speed * math.tan(float(replay.steer[frame, robot])) / replay.config.robot.wheelbase
        turn = -turn if replay.config.robot.front_steered else turn
        velocity = {"vx": round(speed, 3), "vy": 0.0, "omega": round(turn, 4)}
        theta = min(max(round(theta, 4), -_HALF_TURN), _HALF_TURN)
        position = {"x": x, "y": y, "theta": theta, "mapId": self._map, "positionInitialized": True}
        return {"agvPosition": position, "velocity": velocity}


def messages_of(
    story: Story, names: Names, every: float | None = None, moved: Callable[[], object] = lambda: None
) -> Iterator[Message]:
    """Yield all messages of a story.

    every: seconds between two visualizations of a vehicle (None: each step). moved: called after each moment.
    """
    step, last = story.replay.seconds, len(story.replay.pose) - 1
    stride = 1 if every is None else round(every / step)
    if stride < 1:
        raise ConfigError(f"--every {every:g} must be at least {step:g}, a step of the episode [s]")
    robots = range(story.replay.config.num_agents)
    both = [(VehicleWriter(story, robot), Sender(names, serial_of(robot))) for robot in robots]
    factsheet = factsheet_of(story.replay.config, stride * step)
    for _, sender in both:
        yield sender.message(0.0, "connection", {"connectionState": "ONLINE"})
        yield sender.message(0.0, "factsheet", factsheet)
    for frame in range(last + 1):
        for vehicle, sender in both:
            for name, body in vehicle.at(frame):
                yield sender.message(frame * step, name, body)
            if frame % stride == 0:
                yield sender.message(frame * step, "visualization", vehicle.where(frame))
        moved()
    for _, sender in both:
        yield sender.message(last * step, "connection", {"connectionState": "OFFLINE"})
