"""Pieces of work whose rows go into a file as each ends, so that a stop loses the pieces at hand at most."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeVar

from train.evaluation.processes import work_all
from train.reporting.report import make_progress
from train.reporting.rows import Row, RowFile

Piece = TypeVar("Piece")


def run_missing(
    work: Callable[[Piece], list[Row]],
    missing: Sequence[Piece],
    file: RowFile,
    processes: int,
    say: Callable[[Row], str],
    *,
    done: int = 0,
    size: Callable[[Piece], float] | None = None,
) -> list[Row]:
    """Run the missing pieces under a bar and return their rows, in the order in which they ended.

    say: from a piece's first row to what the bar says; done: what the bar starts from; size: how far a piece moves it,
    1 if left out. KeyboardInterrupt says what was kept.
    """
    size = size or (lambda piece: 1.0)
    rows: list[Row] = []
    try:
        with make_progress() as progress:
            bar = progress.add_task(f"{processes} processes", total=done + sum(map(size, missing)), completed=done)
            for piece, fresh in work_all(partial(_with_piece, work), missing, processes):
                file.add(fresh)
                rows += fresh
                progress.update(bar, advance=size(piece), description=say(fresh[0]))
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"{file.kept()}; the same command goes on from there") from None
    return rows


def _with_piece(work: Callable[[Piece], list[Row]], piece: Piece) -> tuple[Piece, list[Row]]:
    return piece, work(piece)
