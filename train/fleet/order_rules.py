"""The rules of VDA 5050 for orders, and for the orders in states."""

import itertools
from collections.abc import Iterator
from typing import Any

from warehouse_env.errors import shown

Point = tuple[int, str, bool]
"""Sequence id, name and whether it is released, of a node or an edge."""


def points_of(listed: list[dict[str, Any]], name: str) -> list[Point]:
    """Return the nodes or edges of an order or a state."""
    return [(one["sequenceId"], one[name], one["released"]) for one in listed]


class OrderBook:
    """The updates of one vehicle's order."""

    def __init__(self) -> None:
        self._id: str | None = None
        self._nodes: dict[int, list[Point]] = {}  # all of the order, as of each update
        self._edges: dict[int, list[Point]] = {}
        self._last = -1  # update
        self._open = False  # not done, by the last state
        self._cancelled = False

    def act(self, payload: dict[str, Any]) -> None:
        """Take an instant action: after cancelOrder another order may come at once."""
        actions = payload.get("actions")
        for action in actions if isinstance(actions, list) else ():
            if isinstance(action, dict) and action.get("actionType") == "cancelOrder":
                self._cancelled = True

    def order(self, payload: dict[str, Any]) -> Iterator[str]:
        """Take an order or its update; yield what is wrong."""
        nodes, edges = points_of(payload["nodes"], "nodeId"), points_of(payload["edges"], "edgeId")
        wrong = list(_chain(payload, nodes, edges))
        yield from wrong
        if wrong:
            return
        number, update = payload["orderId"], payload["orderUpdateId"]
        if number != self._id:
            if self._open and not self._cancelled:
                yield f"order {shown(number)} comes while {shown(self._id)} is under way"
            self._id, self._nodes, self._edges, self._open, self._cancelled = number, {}, {}, True, False
        else:
            if update <= self._last:
                yield f"update {update} of order {shown(number)} comes after {self._last}"
                return
            base = [node for node in self._nodes[self._last] if node[2]]
            if nodes[0] != base[-1]:
                yield f"update {update} begins at {shown(nodes[0][:2])}, not at the base's last node {base[-1][:2]}"
                return
            nodes = [*base[:-1], *nodes]
            edges = [*(edge for edge in self._edges[self._last] if edge[0] < base[-1][0]), *edges]
        self._last = update
        self._nodes[update], self._edges[update] = nodes, edges

    def state(self, payload: dict[str, Any]) -> Iterator[str]:
        """Take a state; yield what contradicts the order that it names."""
        nodes, edges = (points_of(payload[f"{kind}States"], f"{kind}Id") for kind in ("node", "edge"))
        number, update, at = payload["orderId"], payload["orderUpdateId"], payload["lastNodeSequenceId"]
        undone = any(one["actionStatus"] not in ("FINISHED", "FAILED") for one in payload["actionStates"])
        self._open = bool(nodes or edges or undone) and number == self._id
        if not number:
            if nodes or edges:
                yield "it has nodes or edges without an order"
            return
        if number != self._id or update not in self._nodes:
            if self._id is not None:
                yield f"it has update {update} of order {shown(number)}, which was not sent"
            return
        ordered = self._nodes[update]
        if (at, payload["lastNodeId"]) not in [node[:2] for node in ordered if node[2]]:
            yield f"its last node {shown(payload['lastNodeId'])} with sequence id {at} is not in its base"
            return
        if nodes != [node for node in ordered if node[0] > at]:
            yield f"its nodeStates are not the order's nodes after sequence id {at}"
        if edges != [edge for edge in self._edges[update] if edge[0] > at]:
            yield f"its edgeStates are not the order's edges after sequence id {at}"


def _chain(payload: dict[str, Any], nodes: list[Point], edges: list[Point]) -> Iterator[str]:
    """Yield what is wrong with an order by itself."""
    if not nodes or not nodes[0][2]:
        yield "its first node is missing, or not released"
        return
    if len(edges) != len(nodes) - 1:
        yield f"it has {len(nodes)} nodes and {len(edges)} edges"
        return
    first = nodes[0][0]
    numbers = sorted(point[0] for point in (*nodes, *edges))
    if first % 2 or numbers != [*range(first, first + len(numbers))] or [node[0] for node in nodes] != numbers[::2]:
        yield "the sequence ids of its nodes and edges do not count up in turn from an even one"
    ends = [(edge["startNodeId"], edge["endNodeId"]) for edge in payload["edges"] if "startNodeId" in edge]
    if ends and ends != [(first[1], last[1]) for first, last in itertools.pairwise(nodes)]:
        yield "its edges do not join its nodes one after the other"
    released = [node[2] for node in nodes]
    if [edge[2] for edge in edges] != released[1:] or released != sorted(released, reverse=True):
        yield "its base is not followed by its horizon"
