"""Drawing actions from network outputs, in NumPy, so that the given generator alone decides."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def draw_discrete(logits: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.int64]:
    """Draw one action a row with probability softmax(logits): int64[M] from float32[M, A].

    The Gumbel trick: argmax of logits + G.
    """
    choice: NDArray[np.int64] = np.argmax(logits + gumbel(logits.shape, rng), axis=-1)
    return choice


def gumbel(shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float32]:
    """Draw from the standard Gumbel distribution: -log(E), where E is a standard exponential."""
    exponential = rng.standard_exponential(shape, dtype=np.float32)
    exponential += np.float32(1e-30)  # an exact 0 would win against any logit
    noise: NDArray[np.float32] = -np.log(exponential)
    return noise
