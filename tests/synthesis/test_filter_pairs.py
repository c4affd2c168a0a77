"""Gains for each pair of modes, which the projection lemma gives: what they could gain over one filter per mode."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.filters import farhat

from codegen.selection.filters import design_filter
from codegen.synthesis import hinf_filter, hinf_projection


@pytest.mark.parametrize("case", [(True, False), (False, False)])
def test_gains_per_pair_of_modes_would_gain_nothing(case):
    """The bound of the projections holds for them too: what is certified with one filter per mode is within .02 %.

    Multipliers other than those of the slack variables only raise it.
    """
    problem = farhat(*case)
    start = hinf_filter.design(problem)
    apart = hinf_projection.in_coordinates(problem, hinf_projection.even_states(start.proof["P"], problem.sizes[0]))

    def bound(factors):
        scaled_by = [[{"tau": given["tau"] * factor} for given in row]
                     for row, factor in zip(start.proof["multipliers"], factors)]
        extended = [hinf_projection.Extended(m, row) for m, row in zip(apart.modes, scaled_by)]
        return np.sqrt(hinf_projection.eliminated(apart, extended)[0])

    own = bound((1, 1))
    assert own * (1 - 1e-6) <= start.gamma <= own * (1 + 1e-6) and design_filter(problem).gamma <= own * 1.0002
    if case[0]:
        others = [bound(f) for f in ((0.8, 1), (1.25, 1), (1, 0.8), (1, 1.25), (0.8, 0.8), (1.25, 1.25))]
        assert min(others) > own * 1.0005 and max(others) > own * 1.1


def test_pairs_of_the_projections_belong_together():
    """[R I; I S] >= 0, which is not printed: at the least level nothing else sees to it."""
    problem = farhat(False, True)
    _, R, S = hinf_projection.eliminated(problem, [hinf_projection.Extended(m, []) for m in problem.modes])
    unit = np.eye(problem.sizes[0])
    assert min(np.linalg.eigvalsh(np.block([[r, unit], [unit, s]]))[0] for r, s in zip(R, S)) > -1e-6
