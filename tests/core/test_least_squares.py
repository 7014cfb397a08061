"""Claims about the searches for a minimum by which every fit finds its parameters."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ldt_core.estimation.least_squares import KEPT_MOVE, ForwardDifferences, trust_region

NARROW = 1000.0  # noise deviations by which a unit beside the valley moves the rows


def valley(z):
    """Rosenbrock's: its floor is y = x², its minimum at (1, 1)."""
    return np.array([NARROW * (z[1] - z[0] ** 2), 1 - z[0]])


def slopes(z):
    return np.array([[-2 * NARROW * z[0], NARROW], [-1.0, 0.0]])


def test_a_narrow_valley_that_bends_is_followed_to_its_end():
    """In few evaluations, since full steps may leave its floor in between."""
    start, low, high = np.array([-1.0, 1.0]), np.full(2, -5.0), np.full(2, 5.0)
    found = trust_region(valley, start, low, high, slopes, max_nfev=4)
    assert found.z == pytest.approx([1.0, 1.0], abs=1e-6)
    np.testing.assert_allclose(found.jacobian, slopes(found.z))
    alone = trust_region(
        valley, start, low, high, max_nfev=4
    )  # difference quotients: no full steps
    assert float(alone.residual @ alone.residual) > 0.1


@given(x=st.integers(-30, 30), y=st.integers(-30, 30), evaluations=st.integers(1, 8))
def test_full_steps_make_nothing_worse(x, y, evaluations):
    """What is found is within the bounds, and no further up than where the search began."""
    start, low, high = np.array([x, y]) / 10, np.full(2, -4.0), np.full(2, 4.0)
    found = trust_region(valley, start, low, high, slopes, max_nfev=evaluations)
    assert np.all((low <= found.z) & (found.z <= high))
    begun, ended = valley(start), found.residual
    assert float(ended @ ended) <= float(begun @ begun) * (1 + 1e-12)
    np.testing.assert_array_equal(found.residual, valley(found.z))


@pytest.mark.parametrize("start", [2.0, 2.5, 3.0])
def test_long_quotients_pass_over_corners_and_grow_short_at_the_end(start):
    """Short ones stay on the first corner; where nothing has corners, the slopes are exact."""

    def ended(height, longest):
        def rows(points):
            return [
                np.array([z[0] - 1.0, z[1] + z[0] ** 2]) + height * np.abs((50 * z) % 2 - 1)
                for z in points
            ]

        search = ForwardDifferences(rows, 1e-6, np.full(2, 9.0), longest=longest)
        begun, low, high = np.full(2, start), np.full(2, -9.0), np.full(2, 9.0)
        found = trust_region(search.residual, begun, low, high, search.jacobian)
        return found, float(found.residual @ found.residual)

    assert ended(0.2, 1e-6)[1] > 10
    assert ended(0.2, 0.3)[1] < 0.1
    smooth, loss = ended(0.0, 0.3)
    assert loss < 1e-9
    np.testing.assert_allclose(smooth.jacobian, [[1, 0], [2, 1]], atol=1e-3)


def test_a_derivative_is_kept_while_its_coordinate_stays_near():
    """Of a number that is known well, and found anew once it has moved."""
    asked = []

    def rows(points):
        asked.append(len(points))
        return [np.array([np.exp(z[0]), z[1]]) for z in points]

    steady = np.array([True, False])
    quotients = ForwardDifferences(rows, 1e-6, np.full(2, 9.0), steady)
    first = quotients.jacobian(np.zeros(2))
    near = quotients.jacobian(np.array([0.9 * KEPT_MOVE, 1.0]))
    assert near[0, 0] == first[0, 0]
    far = quotients.jacobian(np.array([2.0, 1.0]))
    assert far[0, 0] == pytest.approx(np.exp(2.0), rel=1e-4)
    assert asked == [3, 2, 3]


@given(x=st.floats(-2, 2), y=st.floats(-2, 2), u=st.floats(-2, 2))
def test_what_is_computed_along_is_what_would_be_asked_for(x, y, u):
    """With room for three points beside each other, no derivative is asked for after a residual."""
    asked = {1.0: [], 3.0: []}
    found = {}
    for abreast, counts in asked.items():

        def rows(points, counts=counts):
            counts.append(len(points))
            return [valley(z) for z in points]

        quotients = ForwardDifferences(rows, 1e-6, np.full(2, 1.5), abreast=abreast)
        z = np.array([x, y])
        found[abreast] = (
            quotients.residual(z),
            quotients.jacobian(z),
            quotients.residual_alone(z + u),
        )
    for one, other in zip(*found.values(), strict=True):
        np.testing.assert_array_equal(one, other)
    assert asked == {1.0: [1, 2, 1], 3.0: [3, 0, 1]}
