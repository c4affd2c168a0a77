"""The published example of Zammali (2020), section 3.3.3 (discrete time), and what of it does not hold.

* At the printed alpha = 0.9 there is no design, with any gains: C z = 0 for z = (1, 1), so (A - L C) z = A z, and
  A(theta) keeps 0.418 of z in mode 3, more than sqrt(1 - 0.9). The largest alpha is below 0.8253.
* The printed gamma = 2.12 belongs to the box [0.5, 1]^2 in all modes; even there 1.945 is possible.
* The corrected levels of the dossier come out: 4.316, 2.2225, 1.764 at alpha = 0.8, 0.7, 0.5 (the printed LMI is blind
  to the noise through L, ours is not: within 0.1 %). At 0.82 theirs needs one P per mode.
* gamma is no measure of the width: with L = 0 the intervals are three times narrower than with the printed gains.
"""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from codegen.errors import DesignError
from codegen.plant.load import load
from codegen.plant.simulate import simulate
from codegen.selection.select import choose
from codegen.synthesis.linf import LinfProblem
from codegen.synthesis.problem import Problem
from codegen.synthesis.structure import obstruction

PLANT = load("zammali_lpv_dt")
NARROW = replace(PLANT, modes=tuple(replace(m, theta_bounds=(np.full(2, 0.5), np.ones(2))) for m in PLANT.modes))
PRINTED_P = np.array([[2.71, 2.43], [2.0, 2.0], [2.48, 2.58]])
PRINTED_L = np.array([[[-0.0035], [0]], [[-0.0263], [0]], [[0.0118], [0]]])
PRINTED_SLOPES = np.zeros((3, 2, 2, 1))
PRINTED_SLOPES[:, 1, 1, 0] = [-0.045, 0.013, -0.01]


def level(plant, alpha):
    """gamma of Theorem 10 at alpha_1 = 2 with a common P; None where the LMI has no solution."""
    solved = LinfProblem(Problem.of(plant, tnl=False), multiple=False).solve(alpha)
    return None if solved is None else float(np.sqrt(2 * solved["mu"]))


def gamma_of(plant, P, L, slopes, alpha):
    """Smallest gamma that certifies given P and gains: largest eigenvalue of P + P A ((1-a) P - A'P A)^-1 A' P."""
    worst = 0.0
    for q, mode in enumerate(plant.observed.modes):
        D = np.diag(P[q])
        for corner in product(*zip(mode.theta_lo, mode.theta_hi)):
            A = mode.A + np.tensordot(corner, mode.A_theta, 1) - (L[q] + np.tensordot(corner, slopes[q], 1)) @ mode.C
            left = (1 - alpha) * D - A.T @ D @ A
            if np.min(np.linalg.eigvalsh(left)) <= 0:
                return np.inf
            worst = max(worst, np.max(np.linalg.eigvalsh(D + D @ A @ np.linalg.solve(left, A.T @ D))))
    return float(np.sqrt(worst))


# -- the printed alpha -----------------------------------------------------------------------------
def test_printed_alpha_is_infeasible_and_the_user_is_told_why():
    assert level(PLANT, 0.9) is None
    with pytest.raises(DesignError) as error:
        choose(PLANT, "lpv-interval", {"criterion": "linf", "lambda": 0.9}, lambda text: None)
    for words in ("lambda = 0.9", 'mode "3"', "theta = (3, 3)", "C z = 0", "0.418", "below 0.8253"):
        assert words in str(error.value)
    assert obstruction(Problem.of(PLANT, tnl=False)) is None  # the plant itself is no obstacle


def test_unseen_direction():
    """Smallest row sums of A at the worst corner: 0.320 in mode 2, 0.418 in mode 3, both above sqrt(0.1)."""
    corners = [list(product(*zip(m.theta_lo, m.theta_hi))) for m in PLANT.observed.modes]
    sums = [max(np.min((m.A + np.tensordot(c, m.A_theta, 1)).sum(axis=1)) for c in box)
            for m, box in zip(PLANT.observed.modes, corners)]
    assert sums[1] == pytest.approx(0.320, abs=1e-3) and sums[2] == pytest.approx(0.418, abs=1e-3)
    assert 1 - sums[2] ** 2 == pytest.approx(0.8253, abs=5e-4)
    assert level(PLANT, 0.83) is None


# -- levels ----------------------------------------------------------------------------------------
@pytest.mark.parametrize(("alpha", "gamma"), [(0.8, 4.316), (0.7, 2.2225), (0.5, 1.764)])
def test_corrected_levels(alpha, gamma):
    assert level(PLANT, alpha) == pytest.approx(gamma, rel=1e-3)


def test_printed_level_belongs_to_the_narrow_box():
    assert gamma_of(NARROW, PRINTED_P, PRINTED_L, PRINTED_SLOPES, 0.9) == pytest.approx(2.1193, abs=1e-3)
    assert gamma_of(PLANT, PRINTED_P, PRINTED_L, PRINTED_SLOPES, 0.9) == np.inf
    assert level(NARROW, 0.9) == pytest.approx(1.9449, rel=1e-3)


# -- widths ----------------------------------------------------------------------------------------
def widths(design, seed=0):
    """Mean width of each state from sample 20 on; the run must be contained and quiet."""
    run = simulate(PLANT, "corner", seed=seed)
    out = design.observer.run(u=run.u, y=run.y, q=run.q, theta=run.theta, real="float64")
    assert np.all((out.x_lo <= run.x) & (run.x <= out.x_hi)) and not out.raw_bits.any()
    return (out.x_hi - out.x_lo)[20:].mean(axis=0)


def fixed(L, slopes):
    return choose(PLANT, "lpv-interval", {"gains": {"L": L.tolist(), "L_theta": slopes.tolist()}}, lambda text: None)


def test_no_gain_is_narrower_than_the_printed_gains():
    """Dossier: printed (0.031, 0.050), L = 0 (0.0096, 0.0152), on other sequences of modes."""
    printed = widths(fixed(PRINTED_L, PRINTED_SLOPES))
    none = widths(fixed(0 * PRINTED_L, 0 * PRINTED_SLOPES))
    assert printed == pytest.approx([0.031, 0.050], rel=0.25)
    assert none == pytest.approx([0.0096, 0.0152], rel=0.25)
    assert np.all(3 * none < 1.05 * printed)


@pytest.mark.parametrize("criterion", ["width", "linf"])
def test_own_gains_are_sound(criterion):
    options = {"criterion": criterion, **({"lambda": 0.7} if criterion == "linf" else {})}
    design = choose(PLANT, "lpv-interval", options, lambda text: None)
    for seed in range(3):
        widths(design, seed)


def test_width_criterion_is_the_narrowest_where_it_counts():
    """It bounds the worst steady width over all parameters, so it is compared at that, not along one path."""
    own = choose(PLANT, "lpv-interval", {"criterion": "width"}, lambda text: None)
    none = fixed(0 * PRINTED_L, 0 * PRINTED_SLOPES)
    worst = [np.sum([d.certificate["float64"]["steady_box"]["width"]], axis=0) for d in (own, none)]
    assert np.all(worst[0] <= worst[1] * (1 + 1e-6))
