"""Detection observers for polytopic descriptor plants: ratio of the dossier, exact certificate, frequency response."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.descriptors import example, plant
from helpers.pencils import CHAPTER_4

from codegen.certify.polytope_detection import check
from codegen.errors import CertificateError, DesignError
from codegen.selection.descriptors import euler_limit, problem_and_scaling
from codegen.selection.detectors import design_detector, faults_of
from codegen.synthesis import hminus_hinf
from codegen.synthesis.descriptor_gains import StandardGains
from codegen.synthesis.descriptor_lmi import Bounds
from codegen.synthesis.descriptor_problem import DescriptorProblem, Scaling, kernel_of
from codegen.synthesis.hminus_hinf import Faults

FREQUENCIES = [0.0, *np.geomspace(1e-2, 1e5, 150)]
#: Printed in section 4.4.
P1 = np.array([[0.7319, 0.1713, 0.6027], [0.1713, 0.4969, 0.0248], [0.6027, 0.0248, 0.6247]])
Q = np.array([[[-1.5306, 0.1067], [-0.6093, -0.4492], [-1.5424, 0.1343]],
              [[-1.1342, 0.4272], [-0.7145, -0.3467], [-1.5371, 0.2009]],
              [[-1.2201, 0.4143], [-0.7364, -0.3354], [-1.5300, 0.2174]]])


@lru_cache
def chapter_4(moving: bool = False) -> tuple[DescriptorProblem, Faults]:
    """Section 4.4: a fault of the second sensor; ``moving`` adds one that pushes the state."""
    E, A, C = CHAPTER_4
    Bd, Dd = np.array([[[1], [0], [0.5]], [[0.5], [0], [0.5]], [[0.2], [0], [0.5]]]), np.array([[0.5], [0.3]])
    problem = DescriptorProblem(("1", "2", "3"), E, np.array(A), example().B, Bd, C, Dd, C, Dd, kernel_of(E),
                                example().pairs, np.ones(1), np.ones(1))
    Bf = np.array([[[0.0], [1.0], [0.0]]] * 3) if moving else np.zeros((3, 3, 1))
    return problem, Faults(Bf, np.array([[0.0], [1.0]]))


def made(criterion: str = "all", free: bool = True, moving: bool = False):
    return _made(criterion, free, moving)


@lru_cache
def _made(criterion, free, moving):
    return design_detector(*chapter_4(moving), Bounds(100.0, 1.0), criterion, free=free)


def responses(gains: StandardGains, problem, into, out, j: int, frequencies=FREQUENCIES) -> list:
    """Residual of the frozen plant and observer over frequency, from the equations of both as two systems.

    ``into``, ``out``: what drives the state and the outputs of the plant.
    """
    n, y = len(problem.E), np.hstack([problem.C, np.zeros(problem.C.shape)])
    estimate, direct = gains.T2 @ y + np.hstack([np.zeros((n, n)), np.eye(n)]), gains.T2 @ out
    r, r_out = y - gains.C @ estimate, out - gains.C @ direct
    A = np.vstack([np.hstack([problem.A[j], np.zeros((n, n))]), gains.F[j] @ estimate - gains.K[j] @ r])
    B = np.vstack([into, gains.F[j] @ direct - gains.K[j] @ r_out])
    E = np.block([[problem.E, np.zeros((n, n))], [np.zeros((n, n)), np.eye(n)]])
    return [r @ np.linalg.solve(1j * w * E - A, B) + r_out for w in frequencies]


def test_the_printed_gains_do_not_hold_what_is_printed():
    """beta = .995 and gamma = 1.160 are claimed; the real residual has these (dossier 9b)."""
    problem, faults = chapter_4()
    T = np.linalg.pinv(np.vstack([problem.E, problem.C]))
    K = np.linalg.solve(P1, Q)
    gains = StandardGains(T[:, 3:], T[:, :3] @ problem.A, T[:, :3] @ problem.B, K, problem.C)
    least = [min(np.linalg.svd(R)[1][-1] for R in responses(gains, problem, faults.Bf[j], faults.Df, j))
             for j in range(3)]
    most = [max(np.linalg.norm(R, 2) for R in responses(gains, problem, problem.Bd[j], problem.Dd, j))
            for j in range(3)]
    assert least == pytest.approx([0.470, 0.459, 0.458], abs=1e-3)
    assert most == pytest.approx([0.308, 0.126, 0.133], abs=1e-3)


def test_the_printed_gains_by_euler_steps():
    """They diverge beyond .112 s (dossier 9b): modes down to -17.8 1/s."""
    problem, _ = chapter_4()
    T = np.linalg.pinv(np.vstack([problem.E, problem.C]))
    ones = Scaling(np.ones(3), np.ones(2), np.ones(3), 1.0)
    limit = euler_limit(problem, SimpleNamespace(T1=T[:, :3], K=np.linalg.solve(P1, Q)), ones)
    assert limit == pytest.approx(0.112, abs=5e-4)


def test_levels_of_the_dossier():
    assert made().designed == pytest.approx(0.3938, abs=6e-5)
    problem, faults = chapter_4()
    found = hminus_hinf.design(problem, faults, Bounds(1e4, 0.0), "all", False, np.eye(2) / 0.47**2)
    assert 0.47 * found.gamma == pytest.approx(0.3099, abs=6e-5)  # one T1 for all vertices, beta = .47


@pytest.mark.parametrize("case", [("all", True, False), ("slow", True, False), ("slow", True, True)])
def test_frequency_response_of_the_certified_detector(case):
    """Sensitivity at every frequency (or at rest) and level of the disturbance, of the rounded constants."""
    (problem, faults), found = chapter_4(case[2]), made(*case)
    assert found.ratio <= found.designed * (1 + 1e-6)
    assert check(problem, faults, found.gains, found.M, found.proof) == found.claims and len(found.claims) == 3
    for M in (*vars(found.gains).values(), found.M):
        assert np.array_equal(M, M.astype("float32"))
    least, most = [], []
    for j in range(3):
        heard = responses(found.gains, problem, faults.Bf[j], faults.Df, j, FREQUENCIES if case[0] == "all" else [0.0])
        least.append(min(np.linalg.svd(found.M @ R)[1][0] for R in heard))
        most.append(max(np.linalg.norm(found.M @ R, 2)
                        for R in responses(found.gains, problem, problem.Bd[j], problem.Dd, j)))
    assert found.beta * (1 - 1e-9) <= min(least) <= 1.5 * found.beta
    assert max(most) <= found.gamma


def test_a_slow_criterion_hears_what_the_other_pays_for():
    """All frequencies cost in ratio what a constant fault does not need."""
    assert made("slow").ratio < made("all").ratio
    fast = responses(made("slow").gains, *[chapter_4()[0]], chapter_4()[1].Bf[0], chapter_4()[1].Df, 0, [1e5])[0]
    assert np.linalg.norm(made("slow").M @ fast) < 0.95 * made("slow").beta  # and it promises nothing there


def test_more_faults_than_the_residual_has_rows_at_high_frequency():
    p, s = problem_and_scaling(plant("dlpv"))
    faults = faults_of(plant("dlpv"))
    with pytest.raises(DesignError, match='rank less than the number of faults.*criterion = "slow"'):
        design_detector(p, faults, Bounds(10.0, 1.0), "all", s=s)
    found = design_detector(p, faults, Bounds(10.0, 1.0), "slow", s=s)
    for j in range(3):
        R = responses(found.gains, p, faults.Bf[j], faults.Df, j, [0.0])[0]
        assert np.linalg.svd(found.M @ R)[1][-1] >= found.beta * (1 - 1e-9)


def test_what_does_not_apply_is_said():
    problem, faults = chapter_4()
    with pytest.raises(DesignError, match="expected one of all, slow"):
        design_detector(problem, faults, Bounds(10.0, 1.0), "other")
    with pytest.raises(DesignError, match="the plant is discrete"):
        design_detector(replace(problem, kind="discrete"), faults, Bounds(10.0, 1.0))
    tied = replace(problem, pairs=((0, 0), (1, 1), (2, 2)))
    with pytest.raises(DesignError, match="3 of 9 pairs"):
        design_detector(tied, faults, Bounds(10.0, 1.0))
    with pytest.raises(CertificateError, match="T1 for every vertex with 3 pairs"):
        check(tied, faults, made().gains, made().M, made().proof)
    with pytest.raises(DesignError, match="signals.f is empty"):
        faults_of(replace(plant("disc"), f=()))
    with pytest.raises(DesignError, match="no T1, T2"):
        design_detector(replace(problem, C=problem.C[:, [0, 2, 1]] * [0, 1, 0]), faults, Bounds(10.0, 1.0))


def more_sensitive(gains, M, proof):
    proof["fault"]["beta"] *= 1.01


def and_its_level(gains, M, proof):
    proof["fault"]["beta"] *= 1.1
    proof["fault"]["level2"] *= 1.21


def quieter(gains, M, proof):
    proof["level"]["level2"] *= 0.98


def lighter(gains, M, proof):
    M[:] *= 0.9


def heavier(gains, M, proof):
    M[:] *= 1.1


def other_criterion(gains, M, proof):
    proof["criterion"] = "slow" if proof["criterion"] == "all" else "all"


def indefinite(gains, M, proof):
    proof["fault"]["Y1"][0][0] *= -1


def gain_of_another_vertex(gains, M, proof):
    gains.K[1] = -gains.K[0]


def faster(gains, M, proof):
    proof["level"]["decay"] = 20.0


@pytest.mark.parametrize("case", [("all", True, False), ("slow", True, True)], ids=["all", "slow, moving"])
@pytest.mark.parametrize("mutant", [more_sensitive, and_its_level, quieter, lighter, heavier, other_criterion,
                                    indefinite, gain_of_another_vertex, faster], ids=lambda m: m.__name__)
def test_the_exact_check_refuses(mutant, case):
    (problem, faults), found = chapter_4(case[2]), made(*case)
    gains, M, proof = deepcopy(found.gains), found.M.copy(), deepcopy(found.proof)
    mutant(gains, M, proof)
    with pytest.raises(CertificateError):
        check(problem, faults, gains, M, proof)
