"""Observers that solve the algebraic equations themselves, from plant to certified tables.

The design is one in continuous time whose Euler steps contract; what is certified is the recursion that the firmware
runs, on its constants: level and contraction for the plant by Euler steps, thresholds for the plant itself.
"""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from ..algebra.pencil import finite_eigenvalues
from ..errors import CertificateError, DesignError
from ..observers import DescriptorTables
from ..plant.model import Plant
from ..synthesis import descriptor_direct
from ..synthesis.descriptor_gains import StandardGains, rounded
from ..synthesis.descriptor_lmi import Bounds
from ..synthesis.descriptor_problem import scaled
from .descriptors import SPARE, problem_and_scaling
from .descriptors import certified as certified_energy
from .polytopic_designs import GAIN, Proposal, decay_of
from .polytopic_tables import frozen, tables_of, without_dust

Array = np.ndarray


def propose(plant: Plant, method: str, options: dict) -> Proposal:
    """Design.

    Parameters
    ----------
    plant : Plant
        One that ``descriptor_direct.inapplicable`` does not refuse.
    method : str
        There is one.
    options : dict
        Of ``[observer]``: decay, gain, channel.

    Returns
    -------
    Proposal

    Raises
    ------
    DesignError
        No observer exists within the bounds, or Euler steps of it diverge at the plant's period.
    """
    problem, s = problem_and_scaling(plant, options.get("channel", "state"))
    period = plant.sample_period
    decay, gain = float(options.get("decay", decay_of(problem, period))), float(options.get("gain", GAIN))
    bounds = Bounds(gain, (1 + SPARE) * decay / s.time, (1 + SPARE) * period * s.time)
    p = scaled(problem, s)
    found = descriptor_direct.design(p, bounds)
    modes = np.concatenate([finite_eigenvalues(p.E, A - L @ p.C) for A, L in zip(p.A, found.K)])
    limit = float(min(-2 * modes.real / np.abs(modes) ** 2)) / s.time
    if period >= limit:
        raise DesignError(f"{plant.name}: {method}: Euler steps of {period:.4g} s diverge (found), expected less than "
                          f"{limit:.4g} s for these gains. Sample faster, or lower observer.gain.")
    return Proposal(method, problem, s, found, period, limit)


def tables(plant: Plant, proposal: Proposal, real: str) -> DescriptorTables:
    """The numbers that the C holds, but for thresholds and limits of z.

    Parameters
    ----------
    plant : Plant
    proposal : Proposal
    real : {"float32", "float64"}
    """
    problem, s, T = proposal.problem, proposal.s, proposal.period
    (_, n, p, _, _), at = problem.sizes, np.any(problem.E, axis=0)
    T1 = np.zeros((n, n))
    T1[at] = np.linalg.pinv(problem.E[:, at])
    F = T1 @ (problem.E + T * problem.A)
    F[:, ~at] = np.eye(n)[~at]
    L = np.array([s.injection(k) for k in proposal.found.K])
    gains = StandardGains(*(rounded(M, real) for M in (
        np.zeros((n, p)), F, T * (T1 @ problem.B), -T * (T1 @ L), problem.C)))
    base = tables_of(plant, without_dust(gains, s, problem.u_unit, real), np.eye(p), real)
    pivot, P, Q = (rounded(M, real).astype(real) for M in descriptor_direct.solved(problem))
    return DescriptorTables(**{f.name: getattr(base, f.name) for f in fields(base)}, P=P, Q=Q, pivot=pivot,
                            algebraic=tuple(int(k) for k in np.flatnonzero(~at)))


def certified(plant: Plant, proposal: Proposal, options: dict, real: str) -> tuple[DescriptorTables, dict]:
    """Freeze a proposal on one number type and certify level and thresholds.

    Parameters
    ----------
    plant : Plant
    proposal : Proposal
    options : dict
    real : {"float32", "float64"}

    Returns
    -------
    tables : DescriptorTables
    cert : dict

    Raises
    ------
    CertificateError
        No level is proved, or the thresholds are refused.
    DesignError
        No set is kept.
    """
    t = tables(plant, proposal, real)
    if np.any(t.pivot <= 0):
        raise CertificateError(f"{plant.name}: a pivot of the algebraic equations is 0 in {real} (found), expected "
                               "more. Scale the vertices' equations.")
    start = {"form": "descriptor", "time": "discrete", "contraction": 1.0, "period": proposal.period}
    gamma, proof, _ = certified_energy(proposal.problem, t, start, proposal.s)
    rows = options.get("set_rows")
    t, held = frozen(plant, proposal.problem, t, np.zeros((0, 0)), proposal.period, None if rows is None else int(rows))
    return t, {"kind": "polytopic", "level": gamma, "claimed": proposal.found.gamma, "energy": proof,
               "limit": proposal.limit, "thresholds": held, "steady_box": None}
