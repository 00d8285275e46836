"""Small dense matrices."""

import numpy as np
import pytest

from companion.core.model.linear_algebra import dot, solve


@pytest.mark.parametrize("n", [1, 2, 7, 24])
def test_solves_what_numpy_solves(n: int) -> None:
    rng = np.random.default_rng(n)
    a, b = rng.normal(size=(n, n)), rng.normal(size=(n, 3))
    found = b.tolist()
    solve(a.tolist(), found)
    np.testing.assert_allclose(found, np.linalg.solve(a, b), rtol=1e-9, atol=1e-9)


def test_a_zero_on_the_diagonal_is_pivoted_away() -> None:
    found = [[3.0], [5.0]]
    solve([[0.0, 1.0], [1.0, 0.0]], found)
    assert found == [[5.0], [3.0]]


def test_a_singular_matrix_is_refused() -> None:
    with pytest.raises(ZeroDivisionError):
        solve([[1.0, 1.0], [1.0, 1.0]], [[1.0], [2.0]])


def test_a_dot_product_counts_the_first_only() -> None:
    assert dot([1.0, 2.0, 100.0], [3.0, 4.0, 100.0], 2) == 11.0
