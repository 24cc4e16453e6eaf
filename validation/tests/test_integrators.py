"""The integrators beside SciPy's: differences against what runs say of themselves, their tolerances, and their orders."""

from __future__ import annotations

import functools
import math

import pytest

from validation import integrators
from validation.integrators import Comparison, compare

from .common import EPSILON


@functools.cache
def of(name: str) -> Comparison:
    return compare(getattr(integrators, name)())


NAMES = [make.__name__ for make in integrators.CASES]


@pytest.fixture(params=NAMES)
def found(request: pytest.FixtureRequest) -> Comparison:
    return of(request.param)


def known(found: Comparison) -> float:
    """What SciPy's end is known to: its own difference between two tolerances, and rounding of some hundred steps."""
    return max(found.own_q, found.own_v) + 1000 * EPSILON


def test_scipy_is_sharper_than_what_it_judges(found: Comparison) -> None:
    assert found.own_q < 1e-11 and found.own_v < 1e-10
    # No chaos: neighbouring motions part by little.
    assert found.growth < 100, found.growth
    assert len(found.results) >= 5


def test_differences_are_within_ten_times_the_estimate() -> None:
    """In nine of ten runs, as the page on errors says: a companion at another tolerance may err as its run does by chance."""
    good, misses = 0, []
    for found in map(of, NAMES):
        for r in found.results:
            if r.estimated_q is None or r.estimated_v is None:
                # The midpoint method reports conserved quantities instead.
                assert r.method == "midpoint"
                continue
            if r.q <= 10 * r.estimated_q + known(found) and r.v <= 10 * r.estimated_v + known(found):
                good += 1
            else:
                misses.append((found.case.name, r))
    assert good >= 50 and len(misses) <= 0.1 * (good + len(misses)), misses


def test_differences_are_within_the_tolerances(found: Comparison) -> None:
    """Each of n steps errs by at most its tolerance, which grows to the end as a difference of the start does."""
    judged = [r for r in found.results if "rtol" in r.settings]
    assert judged
    for r in judged:
        allowed = r.steps * float(r.settings["rtol"]) * found.growth * (1 + r.largest_v)
        assert max(r.q, r.v) <= allowed + known(found), (found.case.name, r)


@pytest.mark.parametrize(
    ("name", "method", "order"),
    [("pendulum", "midpoint", 2), ("two_links", "rk4", 4), ("four_bar", "rk4", 4), ("floating", "rk4", 4)],
)
def test_fixed_steps_have_their_order(name: str, method: str, order: int) -> None:
    """Steps of a quarter: errors fall by 4 to the order, or faster where the leading term passes through zero (the four-bar's)."""
    coarse, fine = (r for r in of(name).results if r.method == method)
    assert fine.q > 3 * of(name).own_q
    assert math.log(coarse.q / fine.q, 4) > order - 0.2, (coarse, fine)
