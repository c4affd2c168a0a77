"""From a problem to a certified H-infinity filter: design, lower order, round, find its level, check it exactly."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from math import sqrt

import numpy as np

from ..certify.exact import Q, up
from ..certify.switched_gain import check_gain
from ..errors import CertificateError, DesignError
from ..synthesis import hinf_filter, hinf_projection
from ..synthesis.fault_filter import STABLE
from ..synthesis.hinf_analysis import balanced, level_of, rounded, stability_margin
from ..synthesis.hinf_condition import conditioned, in_reach, is_skewed, out_of_reach, radii, unscaled
from ..synthesis.hinf_filter import REMEDY, FilterDesign
from ..synthesis.hinf_problem import FilterProblem, is_slight, without_slight
from ..synthesis.hinf_reduction import reduce_order
from ..synthesis.hinf_weights import post_scaling, scaled

#: Room given to the exact check, in scaled coordinates; the smallest that passes is kept.
MARGINS = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5)


@dataclass(frozen=True)
class CertifiedFilter:
    """A filter as the C will hold it.

    Parameters
    ----------
    gains : tuple of (A, B, C, D), one per mode
    gamma : float
        Proved energy gain from the normalised inputs to the error of the estimate.
    designed : float
        What the solver claimed.
    xi : tuple of ndarray (n_f, n_f)
        Post scaling, already in C and D; empty without.
    proof : dict
        For ``certify.switched_gain.check_gain``.
    """

    gains: tuple
    gamma: float
    designed: float
    xi: tuple
    proof: dict


def proofs(problem: FilterProblem, gains, start: dict):
    """Proofs to be tried: of the problem, then of it less its slight uncertainties, with multipliers for these."""
    some = False
    forms = [(problem, [[np.ones(1) for _ in m.blocks] for m in problem.modes]), conditioned(problem)]
    for plain, scales in reversed(forms) if is_skewed(problem) else forms:
        for margin in MARGINS:
            found = level_of(plain, gains, start, margin)
            if found is not None:
                some = True
                yield found.proof | {"level2": float(found.gamma**2 * (1 + 1e-9)),
                                     "multipliers": unscaled(found.proof["multipliers"], scales)}
    if some or not any(is_slight(b) for m in problem.modes for b in m.blocks):
        return
    plain, scales = conditioned(without_slight(problem))
    for margin in MARGINS[1:]:
        found = level_of(plain, gains, start, margin)
        for tau in () if found is None else (1e-2, 1.0, 1e2, 1e-4, 1e4):
            rows = []
            for m, known in zip(problem.modes, unscaled(found.proof["multipliers"], scales)):
                known = iter(known)
                rows.append([{"tau": tau} if is_slight(b) else next(known) for b in m.blocks])
            yield found.proof | {"multipliers": rows, "level2": float(found.gamma**2 * (1 + 1e-6))}


def certify_filter(problem: FilterProblem, gains, start: dict) -> tuple[float, dict]:
    """Level of given gains, and its proof, checked in exact arithmetic.

    Parameters
    ----------
    problem : FilterProblem
    gains : sequence of (A, B, C, D), one per mode
        Rounded.
    start : dict
        "P" of the design.

    Returns
    -------
    gamma : float
    proof : dict

    Raises
    ------
    CertificateError
        No level is proved.
    """
    reason = "the solver finds no level for the rounded gains. Try float64, or scale states and signals to about 1."
    for proof in proofs(problem, gains, start):
        proof["P"] = [np.asarray(p).tolist() for p in proof["P"]]
        try:
            level2 = check_gain(problem.modes, problem.names, problem.switching, gains, proof)
        except CertificateError as error:
            reason = str(error).removeprefix("certificate: ")
            continue
        gamma = sqrt(float(level2))
        while Q(gamma) * Q(gamma) < level2:
            gamma = np.nextafter(gamma, np.inf)
        return up(Q(gamma)), proof
    raise CertificateError(f"certificate: {reason}")


@dataclass(frozen=True)
class Proposal:
    """Gains before they are rounded.

    Parameters
    ----------
    gains : tuple of (A, B, C, D), one per mode
    claimed : float
        Level of the solver.
    xi : tuple of ndarray (n_f, n_f)
        Post scaling, already in C and D; empty without.
    start : dict
        "P" of the design.
    pairs : float or None
        Of a design by projection: below it gains per pair of modes cannot come, at its multipliers.
    """

    gains: tuple
    claimed: float
    xi: tuple
    start: dict
    pairs: float | None = None


def designed(problem: FilterProblem) -> tuple[FilterDesign, FilterProblem]:
    """Design for the problem as it is stated, else as a solver sees it better; that form of it comes along.

    Raises
    ------
    DesignError
        No filter exists.
    """
    slight = any(is_slight(b) for m in problem.modes for b in m.blocks)
    wholes = [problem, conditioned(problem)[0]]
    forms = [form for whole in (reversed(wholes) if is_skewed(problem) else wholes)
             for form in ((whole, whole), (whole, without_slight(whole)))[:1 + slight]]
    for whole, form in forms:
        with suppress(DesignError):
            return hinf_filter.design(form), whole
    if reason := unstable(problem):
        raise DesignError(reason)
    whole, form = forms[-1]
    moved, T, seen = in_reach(form)
    return out_of_reach(hinf_filter.design(moved), T, seen), whole


def unstable(problem: FilterProblem) -> str:
    """Why no filter of a plant has a level, where the plant itself is the reason; else nothing."""
    radius = radii(problem)
    if np.any(radius >= STABLE):
        q = int(np.argmax(radius))
        return (f'hinf-filter: mode "{problem.names[q]}" has an eigenvalue of size {radius[q]:.9g} (found), expected '
                f"less than 1: a filter of a plant that is not stable by itself has no level. {REMEDY}")
    margin = stability_margin(conditioned(problem)[0])
    if -np.inf < margin <= 1e-7:  # the solver took its own tolerance for a solution
        return ("hinf-filter: the plant itself is not stable under this switching and uncertainty "
                f"(margin {margin:.1e} of 1), so no filter has a level. {REMEDY}")
    return ""


def propose(problem: FilterProblem, synthesis: str = "slack", loss: float = 0.0, post: bool = False) -> Proposal:
    """Design, lower the order, balance the states, scale the estimate; arguments as ``design_filter``.

    Raises
    ------
    DesignError
        No filter exists, or an option is wrong.
    """
    if synthesis not in ("slack", "projection"):
        raise DesignError(f'hinf-filter: synthesis is {synthesis!r}, expected "slack" or "projection".')
    design, problem = designed(problem)
    pairs = None
    if synthesis == "projection":
        found = hinf_projection.design(problem, design)
        design, pairs = found.design, found.bound
    claimed = design.gamma
    if loss > 0:
        design = reduce_order(problem, design, loss)
    design = balanced(design, problem.sizes[0])
    xi = tuple(post_scaling(problem, design.gains)) if post else ()
    return Proposal(tuple(scaled(design.gains, xi) if post else design.gains), claimed, xi, design.proof,
                    pairs)


def certify_proposal(problem: FilterProblem, gains, start: dict) -> tuple[float, dict]:
    """As ``certify_filter``; where no level is proved because the plant itself is unstable, that is said.

    Raises
    ------
    DesignError
    CertificateError
    """
    try:
        return certify_filter(problem, gains, start)
    except CertificateError:
        if reason := unstable(problem):
            raise DesignError(reason) from None
        raise


def design_filter(problem: FilterProblem, real: str = "float32", synthesis: str = "slack", loss: float = 0.0,
                  post: bool = False) -> CertifiedFilter:
    """Design and certify.

    Parameters
    ----------
    problem : FilterProblem
        With its weights.
    real : {"float32", "float64"}
    synthesis : {"slack", "projection"}
    loss : float
        Share by which gamma may rise for a lower order; 0: the order of plant and weights.
    post : bool
        Scale the estimate so that a constant fault is met exactly; the level is that of the scaled filter.

    Returns
    -------
    CertifiedFilter

    Raises
    ------
    DesignError
        No filter exists, or an option is wrong.
    CertificateError
        The exact check refuses every level.
    """
    found = propose(problem, synthesis, loss, post)
    gains = rounded(found.gains, real)
    gamma, proof = certify_proposal(problem, gains, found.start)
    return CertifiedFilter(tuple(gains), gamma, found.claimed, found.xi, proof)
