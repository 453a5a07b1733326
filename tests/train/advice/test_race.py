"""Races: who is out and when, by hand."""

from __future__ import annotations

from collections.abc import Sequence

from train.advice.race import Raced, race


def run(marks: dict[str, Sequence[float]], rounds: int = 4, last: int = 99) -> Raced[str]:
    """Race arms with the values of their rounds; last: the round before which there is no more time."""
    return race(list(marks), lambda left, number: [marks[arm][number] for arm in left], rounds, lambda _, n: n < last)


def test_who_is_told_worse_is_out_after_three_rounds() -> None:
    raced = run({"best": [9, 10, 11, 10], "near": [8, 11, 10, 10], "far": [1, 2, 3, 2]})
    assert raced.left == ["best", "near"]
    assert raced.best == "best"
    assert {arm: len(values) for arm, values in raced.values.items()} == {"best": 4, "near": 4, "far": 3}


def test_it_ends_when_one_is_left_or_the_time_is_over() -> None:
    raced = run({"best": [9, 10, 11, 10], "far": [1, 2, 3, 2]})
    assert raced.left == ["best"]
    assert [len(values) for values in raced.values.values()] == [3, 3]
    assert run({"best": [9, 9], "far": [1, 1]}, last=2).left == ["best", "far"]  # of two rounds nothing is told
    assert run({"best": [9, 9], "far": [1, 1]}, last=0).values == {"best": [], "far": []}
    assert run({}).left == []
