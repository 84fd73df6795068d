"""The newest rows of a table without end, in memory that never grows."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


class Ring:
    """Keeps the last `size` rows.

    Args:
        size: rows kept.
        columns: numbers in a row.
    """

    def __init__(self, size: int, columns: int) -> None:
        self._rows = np.zeros((size, columns))
        self._size = size
        self.added = 0

    def add(self, row: Float[np.ndarray, " column"]) -> None:
        """Adds a row; the oldest makes room for it."""
        self._rows[self.added % self._size] = row
        self.added += 1

    def clear(self) -> None:
        """Forgets all rows."""
        self.added = 0

    @property
    def full(self) -> bool:
        """Whether `size` rows are kept."""
        return self.added >= self._size

    def rows(self) -> Float[np.ndarray, "row column"]:
        """The rows kept, oldest first."""
        if not self.full:
            return self._rows[: self.added].copy()
        return np.roll(self._rows, -(self.added % self._size), axis=0)

    def newest(self, count: int) -> Float[np.ndarray, "row column"]:
        """The last rows, so many where there are, oldest first."""
        first = max(self.added - count, self.added - self._size, 0)
        return self._rows[np.arange(first, self.added) % self._size]

    def padded(self) -> Float[np.ndarray, "row column"]:
        """Always `size` rows: the oldest stands in for those that have not come yet."""
        rows = self.rows()
        return np.concatenate([np.repeat(rows[:1], self._size - rows.shape[0], axis=0), rows])
