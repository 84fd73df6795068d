"""Tables over one or two quantities: linear between breakpoints and held at the edges."""

from __future__ import annotations

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int


def linear(
    x: Float[ArrayLike, "*sample"],
    breakpoints: Float[ArrayLike, " row"],
    values: Float[ArrayLike, " row"],
) -> Float[Array, "*sample"]:
    """The table's value at `x`; beyond the first and last of `breakpoints` it stays the same."""
    values = jnp.asarray(values)
    cell, share = _locate(x, breakpoints)
    return values[cell] + share * (values[cell + 1] - values[cell])


def bilinear(
    x: Float[ArrayLike, "*sample"],
    y: Float[ArrayLike, "*sample"],
    row_breakpoints: Float[ArrayLike, " row"],
    column_breakpoints: Float[ArrayLike, " column"],
    values: Float[ArrayLike, "row column"],
) -> Float[Array, "*sample"]:
    """The table's value at `x` (rows) and `y` (columns), bilinear in each cell.

    Args:
        x: where to read along the rows.
        y: where to read along the columns.
        row_breakpoints: `x` of each row, increasing, at least two.
        column_breakpoints: `y` of each column, increasing, at least two.
        values: the table.
    """
    values = jnp.asarray(values)
    row, down = _locate(x, row_breakpoints)
    column, across = _locate(y, column_breakpoints)
    upper = values[row, column] + across * (values[row, column + 1] - values[row, column])
    lower = values[row + 1, column] + across * (
        values[row + 1, column + 1] - values[row + 1, column]
    )
    return upper + down * (lower - upper)


def _locate(
    x: Float[ArrayLike, "*sample"], breakpoints: Float[ArrayLike, " row"]
) -> tuple[Int[Array, "*sample"], Float[Array, "*sample"]]:
    """Index of the cell that holds `x`, and how far into it `x` lies (0 to 1)."""
    x, breakpoints = jnp.asarray(x), jnp.asarray(breakpoints)
    # Tables are short: counting the breakpoints below is a tenth of the time of a search in halves,
    # which is a loop of its own inside every step of a flight.
    below = jnp.searchsorted(breakpoints, x, side="right", method="compare_all")
    cell = jnp.clip(below - 1, 0, breakpoints.shape[0] - 2)
    share = (x - breakpoints[cell]) / (breakpoints[cell + 1] - breakpoints[cell])
    return cell, jnp.clip(share, 0.0, 1.0)
