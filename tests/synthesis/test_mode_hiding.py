"""Steps of faults hidden by the worst that the plant can do: just below the size that is promised to be found."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import pytest
from helpers.hiding import alarmed, hidden
from helpers.kept import KEPT, family_of

from codegen.designs import read_design
from codegen.plant.bounded import bounded

#: How much of the promised size can be hidden in some mode.
CLOSE = {"follower": 0.95, "trailing": 0.96}


def worst(made, real, promise):
    """The largest hidden step of all modes and both signs, with the run that hides it, and its sign."""
    plant, t = bounded(made.plant), made.observer.tables[real]
    return max(((*hidden(plant, t, q, 0, sign, promise), sign) for q, sign in product(range(plant.n_modes), (1, -1))),
               key=lambda found: found[0])


@pytest.mark.parametrize("family", CLOSE)
def test_no_step_of_the_promised_size_is_hidden(family):
    made = read_design(next(f for f in KEPT if family_of(f) == family))
    promise = made.certificate["float64"]["faults"][0]
    size, u, y, sign = worst(made, "float64", promise)
    assert CLOSE[family] * promise["size"] < size < promise["size"]
    t = made.observer.tables["float64"]
    t = replace(t, v_lo=t.v_lo * (1 + 1e-6), v_hi=t.v_hi * (1 + 1e-6))  # a program is met to its tolerance only
    assert not alarmed(t, u, y)
    y[promise["after"] + 1:] += 0.2 * size * sign  # in the same run a larger one is found
    assert alarmed(t, u, y)
