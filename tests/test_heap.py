"""The heap of the compiled searches."""

from __future__ import annotations

from typing import Any

import numpy as np

from warehouse_env.heap import pop, push
from warehouse_env.kernel import kernel


@kernel
def drained(keys: Any, ties: Any) -> Any:
    count = len(keys)
    heap_keys, heap_items, heap_ties = np.empty(count), np.empty(count, np.int64), np.empty(count)
    size, order = 0, np.empty(count, np.int64)
    for i in range(count):
        size = push(heap_keys, heap_items, size, keys[i], i, heap_ties, ties[i])
    for i in range(count):
        _, order[i], size = pop(heap_keys, heap_items, size, heap_ties)
    return order


@kernel
def drained_untied(keys: Any) -> Any:
    count = len(keys)
    heap_keys, heap_items = np.empty(count), np.empty(count, np.int32)
    size, popped = 0, np.empty(count)
    for i in range(count):
        size = push(heap_keys, heap_items, size, keys[i], i)
    for i in range(count):
        key, item, size = pop(heap_keys, heap_items, size)
        popped[i] = key if keys[item] == key else np.nan
    return popped


def test_items_come_by_key_and_then_by_tie() -> None:
    rng = np.random.default_rng(0)
    keys, ties = rng.integers(0, 9, 200).astype(float), rng.permutation(200).astype(float)
    np.testing.assert_array_equal(drained(keys, ties), np.lexsort((ties, keys)))


def test_without_ties_items_come_by_key_alone() -> None:
    keys = np.random.default_rng(0).integers(0, 9, 200).astype(float)
    np.testing.assert_array_equal(drained_untied(keys), np.sort(keys))
