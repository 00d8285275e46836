"""Small dense matrices as lists of rows. For the sizes that filters have, and compiled: no numpy in the core."""

from __future__ import annotations

Row = list[float]
Matrix = list[Row]


def zeros(rows: int, columns: int) -> Matrix:
    """Filled with 0."""
    return [[0.0] * columns for _ in range(rows)]


def dot(a: Row, b: Row, n: int) -> float:
    """Of the first `n`."""
    total = 0.0
    for k in range(n):
        total += a[k] * b[k]
    return total


def solve(a: Matrix, b: Matrix) -> None:
    """Replaces `b` by the solution of a x = b, and `a` by rubbish; by Gauss. ZeroDivisionError where there is none."""
    n = len(a)
    for k in range(n):
        _bring_up_pivot(a, b, k)
        _eliminate_below(a, b, k)
    for k in range(n - 1, -1, -1):
        _substitute_back(a, b, k)


def _bring_up_pivot(a: Matrix, b: Matrix, k: int) -> None:
    """Exchanges row k with the one, from there on, that is greatest in column k."""
    best, most = k, abs(a[k][k])
    for i in range(k + 1, len(a)):
        size = abs(a[i][k])
        if size > most:
            best, most = i, size
    if best != k:
        a[k], a[best] = a[best], a[k]
        b[k], b[best] = b[best], b[k]


def _eliminate_below(a: Matrix, b: Matrix, k: int) -> None:
    """Takes row k from those below it, so that column k is 0 there (it is not written: nothing reads it)."""
    n, columns = len(a), len(b[k])
    top, right = a[k], b[k]
    inverse = 1.0 / top[k]
    for i in range(k + 1, n):
        row = a[i]
        factor = row[k] * inverse
        if factor != 0.0:
            for j in range(k + 1, n):
                row[j] -= factor * top[j]
            row = b[i]
            for j in range(columns):
                row[j] -= factor * right[j]


def _substitute_back(a: Matrix, b: Matrix, k: int) -> None:
    """Row k of the solution, from those below it."""
    n, columns = len(a), len(b[k])
    top, right = a[k], b[k]
    inverse = 1.0 / top[k]
    for i in range(k + 1, n):
        factor = top[i]
        row = b[i]
        for j in range(columns):
            right[j] -= factor * row[j]
    for j in range(columns):
        right[j] *= inverse
