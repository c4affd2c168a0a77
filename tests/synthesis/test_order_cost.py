"""Order of a zonotope against accuracy and cost, and the count of its operations."""

import numpy as np
import pytest
from helpers.points import gains_of, point_design, random_plant

from codegen.algebra import residual_sets, zonotope
from codegen.analysis.order_cost import order_cost, recursion, supports
from codegen.observers.zonotope import set_work


@pytest.fixture(scope="module")
def design():
    return point_design(random_plant(seed=1), "tnl", order=6)


def test_larger_orders_are_closer_to_the_exact_set_and_cost_more(design):
    records = order_cost(design.plant, design.observer.tables["float32"], [3, 5, 9, 40])
    accuracy, cost, words = ([getattr(r, k) for r in records] for k in ("accuracy", "multiply_adds", "words"))
    assert accuracy == sorted(accuracy, reverse=True) and accuracy[0] > 1.01
    assert 1.0 <= accuracy[3] < 1.0001 and all(r.worst >= r.accuracy for r in records)
    assert cost == sorted(cost) and words == [3 * (r.order + 4) for r in records]


def test_supports_are_those_of_the_algebra(design):
    m = recursion(design.plant, design.observer.tables["float64"])
    path, D, half = [0, 0, 1, 2, 2, 1, 0, 2], zonotope.fan(6), np.array([.1, .2, .3])
    for order in (None, 4):
        h = residual_sets.thresholds(m, path, np.diag(half), D, order)
        np.testing.assert_allclose(supports(m, np.array([path]), half, D, order)[:, 0], h)


def test_an_order_that_diverges_is_infinite():
    """Gains that keep A = [[.3, .75], [-.75, .3]]: stable, |A| is not."""
    plant = random_plant((1, 2, 0, 2), seed=2)
    turn = np.array([[.3, .75], [-.75, .3]])
    t = point_design(plant, order=12).observer.tables["float64"]
    plant.modes[0].A[:] = turn
    t.L[:], t.N[:] = 0.0, 0.0
    small, large = order_cost(plant, t, [2, 40])
    assert small.accuracy == np.inf and large.accuracy < 1.05


@pytest.mark.parametrize("order,compares", [(5, 19), (10, 84)])
def test_work_is_the_dossier_s_count(order, compares, sizes=(3, 2), added=6, noises=3):
    """19 and 84 compares of the selection; a membership test of 2 S^2 multiplications for two residuals."""
    work = set_work(*sizes, order, added, noises)
    columns, terms = order + added, order + added + noises
    magnitudes = 3 * (columns - (order - 3)) + 2 * 3 * (columns + 1) + 2 * (terms + 2) + terms * (terms + 4)
    plain = work.compare - magnitudes  # less the magnitudes of boxes, bounds and supports
    assert plain == compares
    alone = work.multiply - (2 * 3 * columns + 9 * (order - 2) + 6 * columns + 2)
    assert alone == terms * (2 * terms + 4) + 2 and work.words == 3 * columns


def test_gains_are_the_observer_s(design):
    m = recursion(design.plant, design.observer.tables["float64"])
    L = gains_of(design.plant, "tnl")["L"]
    np.testing.assert_allclose(m.A, design.observer.tables["float64"].M, atol=1e-9)
    assert np.allclose(design.observer.tables["float64"].L, L)
