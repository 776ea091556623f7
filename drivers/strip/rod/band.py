"""L D L^T factorisation of a symmetric matrix with half bandwidth 5, in place, and its solution.

Row r of `band` (rows, 7[, LANE_COUNT]) holds 1/D(r) in column 0, L(r, r - j) in column j = 1..5 and
the right-hand side, later the solution, in column 6. Rows before the first unknown are zero.
"""

from typing import Any

from drivers.strip.rod.compiled import kernel
from drivers.strip.rod.lanes import fma, like, load, store

PIVOT_COLUMN, SIDE_COLUMN = 0, 6


@kernel
def eliminate(band: Any, r: int, row: Any, diagonal: Any, side: Any) -> None:
    """Factorise row `r` with A(r, r - j) = a_j, j = 4..1, and substitute its right side forward.

    v_j = A(r, r-j) - sum_{k>j} v_k L(r-j, r-k); L(r, r-j) = v_j / D(r-j);
    D(r) = A(r, r) - sum_j v_j L(r, r-j).
    """
    v4, a3, a2, a1 = row
    v3 = a3 - v4 * load(band, r - 3, 1)
    v2 = fma(-v3, load(band, r - 2, 1), fma(-v4, load(band, r - 2, 2), a2))
    v1 = fma(-v4, load(band, r - 1, 3), fma(-v3, load(band, r - 1, 2), a1))
    v1 = fma(-v2, load(band, r - 1, 1), v1)
    l4 = v4 * load(band, r - 4, PIVOT_COLUMN)
    l3 = v3 * load(band, r - 3, PIVOT_COLUMN)
    l2 = v2 * load(band, r - 2, PIVOT_COLUMN)
    l1 = v1 * load(band, r - 1, PIVOT_COLUMN)
    pivot = fma(-v1, l1, fma(-v2, l2, fma(-v3, l3, fma(-v4, l4, diagonal))))
    side = fma(-l4, load(band, r - 4, SIDE_COLUMN), fma(-l3, load(band, r - 3, SIDE_COLUMN), side))
    side = fma(-l2, load(band, r - 2, SIDE_COLUMN), side)
    side = fma(-l1, load(band, r - 1, SIDE_COLUMN), side)
    store(band, r, 1, l1)
    store(band, r, 2, l2)
    store(band, r, 3, l3)
    store(band, r, 4, l4)
    store(band, r, SIDE_COLUMN, side)
    store(band, r, PIVOT_COLUMN, 1.0 / pivot)


@kernel
def eliminate_fifth(band: Any, r: int, row: Any, diagonal: Any, side: Any) -> None:
    """Factorise row `r` as `eliminate` does, with five entries A(r, r - j) = a_j, j = 5..1."""
    a5, a4, a3, a2, a1 = row
    l5 = a5 * load(band, r - 5, PIVOT_COLUMN)
    store(band, r, 5, l5)
    row_of_four = (
        fma(-a5, load(band, r - 4, 1), a4),
        fma(-a5, load(band, r - 3, 2), a3),
        fma(-a5, load(band, r - 2, 3), a2),
        fma(-a5, load(band, r - 1, 4), a1),
    )
    side = fma(-l5, load(band, r - 5, SIDE_COLUMN), side)
    eliminate(band, r, row_of_four, fma(-a5, l5, diagonal), side)


@kernel
def substitute(band: Any, first: int, last: int) -> None:
    """Solve rows first..last backwards, into column SIDE_COLUMN.

    x_r = y_r / D(r) - sum_j L(r+j, r) x_{r+j}. Rows last + 1 .. last + 5 must exist; their columns
    1..5 and SIDE_COLUMN are overwritten by zeros.
    """
    zero = like(band, 0.0)
    for r in range(last + 1, last + 6):
        for column in range(1, SIDE_COLUMN + 1):
            store(band, r, column, zero)
    for r in range(last, first - 1, -1):
        x = load(band, r, SIDE_COLUMN) * load(band, r, PIVOT_COLUMN)
        x = fma(-load(band, r + 5, 5), load(band, r + 5, SIDE_COLUMN), x)
        x = fma(-load(band, r + 4, 4), load(band, r + 4, SIDE_COLUMN), x)
        x = fma(-load(band, r + 3, 3), load(band, r + 3, SIDE_COLUMN), x)
        x = fma(-load(band, r + 2, 2), load(band, r + 2, SIDE_COLUMN), x)
        x = fma(-load(band, r + 1, 1), load(band, r + 1, SIDE_COLUMN), x)
        store(band, r, SIDE_COLUMN, x)
