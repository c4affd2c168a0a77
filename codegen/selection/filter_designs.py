"""Method "hinf-filter" from plant to certified tables: design once, freeze and certify per number type."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import SimpleNamespace

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from ..analysis.worst_sequence import worst_run
from ..certify import filter_bounds, switched_gain
from ..certify.exact import Q, up
from ..errors import CertificateError, DesignError
from ..observers import FilterTables
from ..plant.model import Plant
from ..synthesis.fault_filter import copies, stated, with_copy
from ..synthesis.hinf_analysis import closed_loop, heard
from . import filter_calibration
from .filter_tables import frozen
from .filters import certify_proposal, propose, unstable

SYNTHESES = ("slack", "projection")
#: An estimate that gets less than this of its fault, in its range, is deaf to it.
DEAF = 0.01


def explore(plant: Plant, options: dict, progress: Callable[[str], None]) -> Iterator[SimpleNamespace]:
    """Certified filters: ``candidate``, ``gains``, ``tables``, ``cert``; without ``synthesis`` that by slack variables.

    Raises
    ------
    DesignError
        No filter exists, or an option is wrong.
    CertificateError
        None survives rounding.
    """
    filter_calibration.asked(options)  # says what is wrong with them before any synthesis
    synthesis = options.get("synthesis", "slack")
    gains = proposed(plant, options, progress)
    progress(f"{synthesis}: thresholds")
    tables, cert = certified(plant, gains, options, plant.target.real)
    label = {"slack": "slack variables", "projection": "projection"}[synthesis]
    yield SimpleNamespace(candidate=SimpleNamespace(label=label, proof=options, figures={}), gains=gains,
                          tables=tables, cert=cert)


def proposed(plant: Plant, options: dict, progress: Callable[[str], None], switching=None) -> dict:
    """Design a filter; ``switching`` in place of the plant's.

    Raises
    ------
    DesignError
        No filter exists, none hears anything of a fault, or an option is wrong.
    """
    problem = under(stated(plant, options, not copies(plant, options))[0], switching)
    synthesis = options.get("synthesis", "slack")
    progress(f"{synthesis}: {len(problem.modes)} modes, {problem.sizes[0]} states")
    proposal = propose(problem, synthesis, float(options.get("order_loss", 0.0)),
                       options.get("post_scaling", "none") == "steady")
    if proposal.pairs is not None:
        progress(f"projection: gains per pair of modes reach {proposal.pairs:.5g} at best, one filter per mode "
                 f"{proposal.claimed:.5g}")
    deaf = heard(problem, proposal.gains) < DEAF
    if np.all(deaf):
        raise DesignError(unstable(problem) or nothing_heard(plant, proposal.claimed))
    missed = [f'"{plant.f[j].name}" in mode "{plant.modes[q].name}"' for q, j in np.argwhere(deaf)]
    if missed:
        progress(f"{synthesis}: the estimate gets next to nothing of fault {', '.join(missed)}")
    return {"kind": "filter", "proposal": proposal, "missed": missed}


def nothing_heard(plant: Plant, level: float) -> str:
    """What to do where no fault is in any estimate."""
    return (f"{plant.name}: no filter does better than one whose estimate is 0 at every sample (found: the level "
            f"{level:.4g}, less than {100 * DEAF:g} % of any fault in its estimate), expected one that follows a "
            "fault. Where faults act a sample late or are fast, estimate their slow part: observer.target = "
            "{ num = [0.1], den = [1, -0.9] }. Else measure more, declare fewer faults, or narrow the bounds of w and "
            "v beside the range of f.")


def under(problem, switching):
    """The same problem, or that under another switching where one is given."""
    return problem if switching is None else problem.under(switching)


def leveled(plant: Plant, gains: dict, options: dict, real: str, switching=None) -> tuple[dict, dict]:
    """Constants of a proposed filter on one number type, and the proof of its level.

    Raises
    ------
    CertificateError
    """
    problem, units = stated(plant, options)
    problem, proposal = under(problem, switching), gains["proposal"]
    if copies(plant, options):
        _, apart = stated(plant, options, False)
        constants = with_copy(apart.emitted(proposal.gains, real), plant.enclosed.observed.modes, real)
        start = start_of(problem, units.gains(constants))
    else:
        constants, start = units.emitted(proposal.gains, real), proposal.start
    level, proof = certify_proposal(problem, units.gains(constants), start)
    reached = None
    if real == plant.target.real:
        reached = worst_run(problem.modes, units.gains(constants), problem.switching, level, steps=60, beam=4).gain
    return constants, {"kind": "filter", "level": level, "claimed": proposal.claimed, "reached": reached,
                       "energy": proof}


def certified(plant: Plant, gains: dict, options: dict, real: str) -> tuple[FilterTables, dict]:
    """Freeze a proposed filter on one number type and certify level and thresholds.

    Raises
    ------
    CertificateError
    """
    constants, cert = leveled(plant, gains, options, real)
    switching, proposal = stated(plant, options)[0].switching, gains["proposal"]
    rows = options.get("set_rows")
    graph = filter_bounds.Graph.of(switching)
    t, held = frozen(plant.enclosed, constants, graph, real, None if rows is None else int(rows))
    add, drain, limit = switching.dwell
    cert |= {"set_of_both": held, "steady_box": None, "dwell_add": add, "dwell_drain": drain, "dwell_limit": limit,
             "post": [x.tolist() for x in proposal.xi], **({} if proposal.pairs is None else {"pairs": proposal.pairs}),
             **({"missed": gains["missed"]} if gains["missed"] else {})}
    if options.get("threshold") == "calibrated":
        return filter_calibration.calibrated(plant, t, cert, options)
    return t, cert


def start_of(problem, gains) -> dict:
    """Where the search for a level starts: states of the size that the unknowns give them, averaged over the modes."""
    reach = 0.0
    for m, gain in zip(problem.modes, gains):
        move, _ = closed_loop(m, gain)
        k = len(move)
        A, E = move[:, :k], move[:, k:k + m.E.shape[1]]
        reach = reach + solve_discrete_lyapunov(A, E @ E.T) / len(problem.modes)
    reach = reach + 1e-9 * np.trace(reach) / len(reach) * np.eye(len(reach))
    return {"P": [np.linalg.inv((reach + reach.T) / 2)] * len(problem.switching.mode)}


def inequalities(plant: Plant, t: FilterTables, cert: dict) -> Iterator[tuple]:
    """The matrices of the level, on the numbers of the C (``switched_gain.inequalities``)."""
    return switched_gain.inequalities(*problem_for(plant, t), cert["energy"])


def demands(plant: Plant, t: FilterTables, cert: dict) -> Iterator[filter_bounds.Demand]:
    """The conditions of the guaranteed thresholds (``filter_bounds.demands``)."""
    graph = filter_bounds.Graph.of(stated(plant, plant.options)[0].switching)
    whole = filter_calibration.guaranteed(t, cert)
    modes, first = plant.enclosed.observed.modes, (plant.x0_lo, plant.x0_hi)
    return filter_bounds.demands(modes, whole, graph, cert["set_of_both"], first)


def problem_for(plant: Plant, t, switching=None) -> tuple:
    """Modes, names, switching and gains, as ``switched_gain`` takes them; ``t`` has the constants of a filter."""
    problem, units = stated(plant, plant.options)
    problem = under(problem, switching)
    gains = units.gains({k: getattr(t, k) for k in ("M", "L", "G", "K", "Dy", "Du")})
    return problem.modes, problem.names, problem.switching, gains


def check(plant: Plant, t: FilterTables, cert: dict) -> list[str]:
    """Re-check a certificate in exact arithmetic; return what is proved, one sentence per claim.

    Raises
    ------
    CertificateError
        Naming mode, row or edge that fails.
    """
    problem = problem_for(plant, t)
    if tuple(problem[2].dwell) != tuple(cert[f"dwell_{k}"] for k in ("add", "drain", "limit")):
        raise CertificateError("certificate: the dwell time is not that of the plant file. Design again.")
    check_level(problem, cert)
    for demand in demands(plant, t, cert):
        demand.require()
    proved = sentences(plant, t, cert)
    if "calibration" in cert:
        return [proved[0], *filter_calibration.check(plant, t, cert), proved[2], proved[3]]
    return proved


def check_level(problem: tuple, cert: dict) -> None:
    """Check the level of a filter exactly; ``problem`` of ``problem_for``.

    Raises
    ------
    CertificateError
    """
    level2 = switched_gain.check_gain(*problem, cert["energy"])
    if Q(cert["level"]) * Q(cert["level"]) < level2:
        raise CertificateError(f"certificate: the level {cert['level']:.6g} (found) is below the proved "
                               f"{up(level2) ** 0.5:.6g}.")


def sentences(plant: Plant, t: FilterTables, cert: dict) -> list[str]:
    """What is proved."""
    slow = "for any switching" if not cert["dwell_add"] else (
        f"while modes last {cert['dwell_add'] / cert['dwell_drain']:g} samples on average (chatter bound "
        f"{cert['dwell_limit'] / cert['dwell_add']:g})")
    target = "W_f f" if "target" in plant.options else "f"
    unsure = ", whatever the parameters do within their bounds" * bool(plant.theta)
    last = "; ".join(f"{m.name}: " + ", ".join(f"{float(h):.4g}" for h in row) for m, row in zip(plant.modes, t.h[-1]))
    left = " (with what constant matrices leave out of a period)" * (plant.kind == "continuous")
    weighted = " (disturbances, noises and inputs before their weight W_d)" if "colour" in plant.options else ""
    return [f"energy: from rest sum |f_hat - {target}|^2 <= {cert['level']:.6g}^2 sum |d|^2, d all disturbances{left}, "
            f"noises, inputs and faults{weighted} in units of their largest sizes, f in units of its range, "
            f"{slow}{unsure} (rounding of sums apart)",
            "while no fault acts no |f_hat| exceeds its f_bound at any sample, so there is no false alarm, "
            f"{slow}{unsure}, rounding included ({t.real}, with or without fused multiply-add)",
            f"once settled f_bound is, by mode, {last}; it comes down to that within {t.lost << t.shift} samples from "
            f"anywhere in the declared range, within {(t.last - t.lost) << t.shift} after a sample without measurement",
            "the state of the filter stays within limits: beyond them it starts again"]
