"""Rows in files: what a stop leaves behind, and what a damaged file says."""

from __future__ import annotations

from pathlib import Path

import pytest

from train.reporting.rows import RowFile, read_rows, whole_rows
from warehouse_env.errors import WarehouseError


def test_a_torn_last_line_is_cut_off_so_that_the_file_can_grow(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    assert whole_rows(path) == []
    path.write_text('{"a": 1}\n{"a": 2')
    assert whole_rows(path) == [{"a": 1}]
    RowFile(path, keep=True).add([{"a": 3}])
    assert read_rows(path) == [{"a": 1}, {"a": 3}]


def test_a_damaged_line_is_named_and_left_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    path.write_text('{"a": 1}\n[1]\n')
    with pytest.raises(WarehouseError, match="line 2"):
        whole_rows(path)
    assert path.read_text() == '{"a": 1}\n[1]\n'
