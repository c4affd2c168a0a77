"""A certified candidate of one method, with the figures by which candidates are compared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..analysis.detectability import SureFault, limited
from ..certify.claims import prove, ultimate_width
from ..certify.freeze import freeze, limits
from ..observers import FramerTables
from ..plant.model import Plant
from ..synthesis.problem import Candidate
from . import filter_designs, points

Array = np.ndarray


@dataclass(frozen=True)
class Trial:
    """A certified candidate and its figures of merit; ``gains`` are those of both framers."""

    method: str
    candidate: Candidate
    gains: dict
    tables: FramerTables
    cert: dict
    faults: list[SureFault]

    def threshold(self, scale: Array) -> float:
        """Largest surely detected fault over the channels, in channel sizes."""
        return max((f.best / s for f, s in zip(self.faults, scale)), default=np.inf)

    @property
    def searched(self) -> float:
        """What the search for the gains found of it, for exact sets; infinite where the design has no such figure."""
        return getattr(self.candidate, "figures", {}).get("threshold", np.inf)

    @property
    def needs_dwell(self) -> bool:
        """The proof holds for slow switching only."""
        return self.cert["kind"] in ("linf", "hinf") and limited(self.cert) is not None

    def width(self, plant: Plant) -> float:
        """Ultimate guaranteed width, summed over the states in units of their ranges."""
        box = ultimate_width(self.cert)
        if box is None:
            return np.inf
        lo, hi = plant.limits("x")
        return float(np.sum(np.array(box) / np.maximum(hi - lo, 1e-300)))

    def summary(self, plant: Plant) -> dict:
        """Row of the report's table of what was tried."""
        return {"method": self.method, "design": self.candidate.label, "level": self.cert.get("level"),
                "relative_width": finite(self.width(plant)),
                "surely_detected": [finite(f.best) for f in self.faults], "chosen": False}


def finite(x: float) -> float | None:
    """JSON has no infinity: None stands for it."""
    return float(x) if np.isfinite(x) else None


def certified(plant: Plant, gains: dict, proof: dict, real: str) -> tuple:
    """Freeze gains on one number type and certify them: tables and certificate.

    Raises
    ------
    CertificateError
    """
    if gains.get("kind") == "filter":
        return filter_designs.certified(plant, gains, proof, real)
    if "kind" in gains:  # of a point observer
        return points.certified(plant.enclosed, gains, proof, real)
    modes = plant.observed.modes
    tables = freeze(FramerTables, modes, limits(plant), gains, real)
    return tables, prove(modes, tables, proof)


def both_sides(c: Candidate, plant: Plant, module=None) -> dict:
    """The same gains for the upper and the lower framer; ``module`` is the method's."""
    gains = {"L_hi": c.L, "L_lo": c.L, "N_hi": c.N, "N_lo": c.N}
    if c.L_theta is not None:
        gains |= {"L_theta": c.L_theta, "midpoint": plant.reads_both_ends, "late": plant.switching.late,
                  "columns": [j for j, s in enumerate(plant.theta) if s.measured],
                  "split": getattr(module, "SPLIT", False)} | ({} if c.R is None else {"R": c.R})
    return gains
