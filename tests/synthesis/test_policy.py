"""Policy iteration finds the smallest steady width; what forbids a decay, and how slow to sample, in numbers."""

from dataclasses import replace

import numpy as np
import pytest

from codegen.errors import DesignError
from codegen.periods import curve, longest, width_at
from codegen.pipeline import design as make
from codegen.plant.load import load
from codegen.synthesis.policy import iterate
from codegen.synthesis.problem import Problem
from codegen.synthesis.structure import slow_reason, unseen_decay


def steady_width(problem: Problem, L, N, rounds: int = 4000):
    """Steady width of given gains by plain iteration over modes and corners, or infinity."""
    W = np.zeros(problem.sizes[1])
    for _ in range(rounds):
        new = []
        for q in range(problem.sizes[0]):
            T = np.eye(len(W)) - N[q] @ problem.C[q]
            push = 2 * np.abs(T @ problem.Bw[q]) @ problem.w_half[q] + 2 * np.abs(L[q] @ problem.Dv[q]) @ problem.v_half
            push += 2 * np.max([np.abs(N[q] @ D) @ problem.v_half for D in problem.Dv], axis=0)
            if problem.x_max is not None:
                count = len(problem.A_unc[q])
                push += 2 * np.abs(T) @ (problem.A_rad[q] @ problem.x_max + problem.u_push[q][count:].sum(axis=0))
                push += 2 * sum(np.abs(T @ F) @ problem.x_max for F in problem.A_unc[q])
                push += 2 * sum(np.abs(T) @ p for p in problem.u_push[q][:count])
            M = T @ problem.A[q] - L[q] @ problem.C[q]
            new.append((np.abs(M) if problem.split else M) @ W + push)
        W, old = np.max(new, axis=0), W
        if np.max(W) > 1e6:
            return np.full(len(W), np.inf)
        if np.all(np.abs(W - old) <= 1e-10 * W):
            break
    return W


@pytest.mark.parametrize(("name", "tnl", "split"), [("zammali_fd", False, False), ("zammali_fd", True, False),
                                                     ("lamouchi", False, True), ("lamouchi", False, True)])
def test_no_gains_nearby_have_a_smaller_steady_width(name, tnl, split):
    problem = Problem.of(load(name), tnl, split)
    best = iterate(problem)
    assert np.allclose(best["width"], steady_width(problem, best["L"], best["N"]), rtol=1e-3)
    rng = np.random.default_rng(1)
    for size in (0.3, 0.03, 0.003):
        for _ in range(40):
            L = best["L"] + size * rng.standard_normal(best["L"].shape)
            N = best["N"] + size * rng.standard_normal(best["N"].shape) * tnl
            M = [(np.eye(len(A)) - n @ C) @ A - k @ C for A, C, k, n in zip(problem.A, problem.C, L, N)]
            if split or np.min(M) >= 0:
                assert np.all(steady_width(problem, L, N) >= best["width"] * (1 - 1e-3))


def test_a_direction_that_the_outputs_do_not_see_limits_the_decay():
    """Zammali (2020), 3.3.3: at the printed alpha = 0.9 nothing exists; C 1 = 0, so row sums of A bound the decay."""
    problem = Problem.of(load("zammali_lpv_dt"), False)
    worst = [max(unseen_decay(A, problem.C[q], False)[0] for _, A in problem.at(q)) for q in range(3)]
    assert worst[1] == pytest.approx(0.320, abs=6e-4) and worst[2] == pytest.approx(0.418, abs=6e-4)
    assert slow_reason(problem, 0.82) is None
    assert "C z = 0" in slow_reason(problem, 0.83) and "below 0.8253" in slow_reason(problem, 0.9)
    with pytest.raises(DesignError, match=r"lambda = 0.9 .* 0.5 .* \+ 0.5 .*below 0.8253"):
        make(load("zammali_lpv_dt"), "lpv-interval", criterion="linf", lambda_=0.9)
    # Below the bound there are designs, and with a seen direction there is no bound at all.
    assert make(load("zammali_lpv_dt"), "lpv-interval", criterion="linf", lambda_=0.7).certificate
    seen = replace(problem, C=np.repeat(np.eye(2)[None], 3, axis=0))
    assert slow_reason(seen, 0.99) is None


def test_the_longest_sampling_period_is_named():
    plant = load("chevet")
    slow = replace(plant, sample_period=50.0)
    with pytest.raises(DesignError, match=r"sample_period is 50 s.*longest period.* s: sample at least as fast"):
        make(slow, "lpv-interval")
    period = longest(slow, False, False)
    assert width_at(plant, period, False, False) is not None and width_at(plant, 1.1 * period, False, False) is None


def test_widths_grow_with_the_period():
    points = curve(load("chevet"), True, False, (0.125, 0.25, 0.5, 1.0, 2.0, 4.0))
    widths = np.array([p.width for p in points])
    assert np.all(np.diff(widths, axis=0) >= -1e-9) and np.all(widths[-1] > 1.2 * widths[0] - 1e-9)
