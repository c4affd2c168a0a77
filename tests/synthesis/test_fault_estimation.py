"""Sensor faults as states: figures of the thesis' bioreactor, bounds that hold, refusals, and tampering that is seen."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from helpers.folders import GENERATED

from codegen.certify import fault_bounds, fault_sets
from codegen.designs import claims_of, read_checked
from codegen.errors import CertificateError, DesignError, PlantError
from codegen.fault_estimators import bend_of_steps, propose, with_faults
from codegen.pipeline import design
from codegen.plant.load import load, loads
from codegen.plant.simulate import simulate
from codegen.synthesis.descriptor_fault_estimation import gains_of
from codegen.synthesis.fault_problem import fault_problem, in_units, inapplicable, told, unmoved

#: Estimate at the start: biomass, cod, methane, growth, faults; as printed, and no consistent one.
PRINTED = np.array([0, 0.5, 1, 0.4, -1, -0.2, 0.3])


@lru_cache
def kept():
    """The committed design."""
    return read_checked(GENERATED / "digester_descriptor-fault-estimation")


@lru_cache
def truth():
    return simulate(kept().plant, "three faults", seed=1)


def faster(times: int):
    """The digester with a shorter period and the same scenario, cut after twelve days."""
    text = load("digester").text.replace("sample_period = 864 ", f"sample_period = {864 / times}")
    for ends in ((1000, 1500), (800, 1600), (1200, 1600)):
        now = [min(1200, k) * times for k in (ends[0] - 300, ends[1])]
        text = text.replace(f"from = {ends[0]}, to = {ends[1]}", f"from = {now[0]}, to = {now[1]}")
    return loads(text.replace("duration = 1382400", "duration = 1036800"))


def estimates(plant, u, y, x0):
    """The observer as it is written down, not as the firmware has it: in the innovation, unrounded."""
    made = propose(plant, "", {})
    g, p = gains_of(made.problem, made.found, made.s, made.period, "float64"), plant.polytope
    z, out = x0 - g.T2 @ (g.C @ x0), []
    for now, seen in zip(u, y):
        x_hat = z + g.T2 @ seen
        h, inside = p.weights(x_hat[:plant.n_x], now)
        assert inside
        terms = np.array([float(k.term.subs(dict(zip(p.symbols, [*x_hat[:plant.n_x], *now])))) for k in p.known])
        values = np.concatenate([x_hat, now, terms, g.C @ x_hat - seen])
        z = np.tensordot(h, np.concatenate([g.F, g.G, g.K], axis=2), 1) @ values
        out.append(x_hat)
    return np.array(out)
