"""L D L^T factorisation of a symmetric matrix with half bandwidth 5, in place, and its solution.

Row r of `band` (rows, 7[, LANE_COUNT]) holds 1/D(r) in column 0, L(r, r - j) in column j = 1..5 and
the right-hand side, later the solution, in column 6. Rows before the first unknown are zero.
"""

from typing import Any

from drivers.strip.rod.compiled import kernel
from drivers.strip.rod.lanes import fma, like, load, store

PIVOT_ROW, SIDE_ROW = 0, 6


@kernel
def eliminate(band: Any, r: int, row: Any, diagonal: Any, side: Any) -> None:
    """Row r with A(r, r - j) = a_j, j = 4..1: its factors and its forward substitution.

    v_j = A(r, r-j) - sum_{k>j} v_k L(r-j, r-k); L(r, r-j) = v_j / D(r-j);
    D(r) = A(r, r) - sum_j v_j L(r, r-j).
    """
    v4, a3, a2, a1 = row
    v3 = a3 - v4 * load(band, r - 3, 1)
    v2 = fma(-v3, load(band, r - 2, 1), fma(-v4, load(band, r - 2, 2), a2))
    v1 = fma(-v4, load(band, r - 1, 3), fma(-v3, load(band, r - 1, 2), a1))
    v1 = fma(-v2, load(band, r - 1, 1), v1)
    l4 = v4 * load(band, r - 4, PIVOT_ROW)
    l3 = v3 * load(band, r - 3, PIVOT_ROW)
    l2 = v2 * load(band, r - 2, PIVOT_ROW)
    l1 = v1 * load(band, r - 1, PIVOT_ROW)
    pivot = fma(-v1, l1, fma(-v2, l2, fma(-v3, l3, fma(-v4, l4, diagonal))))
    side = fma(-l4, load(band, r - 4, SIDE_ROW), fma(-l3, load(band, r - 3, SIDE_ROW), side))
    side = fma(-l2, load(band, r - 2, SIDE_ROW), side)
    side = fma(-l1, load(band, r - 1, SIDE_ROW), side)
    store(band, r, 1, l1)
    store(band, r, 2, l2)
    store(band, r, 3, l3)
    store(band, r, 4, l4)
    store(band, r, SIDE_ROW, side)
    store(band, r, PIVOT_ROW, 1.0 / pivot)


@kernel
def eliminate_fifth(band: Any, r: int, row: Any, diagonal: Any, side: Any) -> None:
    """`eliminate` for a row with A(r, r - j) = a_j, j = 5..1."""
    a5, a4, a3, a2, a1 = row
    l5 = a5 * load(band, r - 5, PIVOT_ROW)
    store(band, r, 5, l5)
    rest = (
        fma(-a5, load(band, r - 4, 1), a4),
        fma(-a5, load(band, r - 3, 2), a3),
        fma(-a5, load(band, r - 2, 3), a2),
        fma(-a5, load(band, r - 1, 4), a1),
    )
    side = fma(-l5, load(band, r - 5, SIDE_ROW), side)
    eliminate(band, r, rest, fma(-a5, l5, diagonal), side)


@kernel
def substitute(band: Any, first: int, last: int) -> None:
    """Solution of rows first..last in column SIDE_ROW: x_r = y_r / D(r) - sum_j L(r+j, r) x_{r+j}.

    Rows last + 1 .. last + 5 must exist; their columns 1..5 and SIDE_ROW are overwritten by zeros.
    """
    zero = like(band, 0.0)
    for r in range(last + 1, last + 6):
        for column in range(1, SIDE_ROW + 1):
            store(band, r, column, zero)
    for r in range(last, first - 1, -1):
        x = load(band, r, SIDE_ROW) * load(band, r, PIVOT_ROW)
        x = fma(-load(band, r + 5, 5), load(band, r + 5, SIDE_ROW), x)
        x = fma(-load(band, r + 4, 4), load(band, r + 4, SIDE_ROW), x)
        x = fma(-load(band, r + 3, 3), load(band, r + 3, SIDE_ROW), x)
        x = fma(-load(band, r + 2, 2), load(band, r + 2, SIDE_ROW), x)
        x = fma(-load(band, r + 1, 1), load(band, r + 1, SIDE_ROW), x)
        store(band, r, SIDE_ROW, x)
