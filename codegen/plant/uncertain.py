"""The plant as the firmware sees it: discrete time, measured parameters, everything else as bounds.

``observed(plant)`` takes a plant with scheduling parameters, or a continuous one, to a discrete-time plant whose
modes are ``UncertainMode``::

    x+ = (A + sum_j theta_j A_theta[j] + sum_l s_l A_unc[l] + dA) x + (the same with B) u + Bw w

with theta the measured parameters, |s_l| <= 1 unknown and free to change at every sample, and |dA| <= A_rad
elementwise. A parameter that is not measured is moved to the middle of its bounds and becomes one s_l; the error
of a measurement becomes another. Keeping s_l apart from the box dA keeps what a parameter does to several
entries at once together: T A_unc[l] can cancel, |T| A_rad cannot.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..algebra.interval import with_products
from .model import Mode, Plant

Array = np.ndarray
#: Matrices that may depend on theta.
SCHEDULED = ("A", "B")


@dataclass(frozen=True)
class UncertainMode(Mode):
    """A discrete-time mode with measured parameters and bounded unknowns.

    Parameters
    ----------
    A_theta : ndarray (J, n_x, n_x), B_theta : ndarray (J, n_x, n_u)
        Slopes in the measured parameters.
    A_unc : ndarray (S, n_x, n_x), B_unc : ndarray (S, n_x, n_u)
        Effects of the unknowns s, |s_l| <= 1; one s_l moves both.
    A_rad : ndarray (n_x, n_x), B_rad : ndarray (n_x, n_u)
        Elementwise bounds of what remains.
    Bf_rad : ndarray (n_x, n_f)
        Elementwise bound on how far the effect of a fault on the state is from Bf f.
    theta_lo, theta_hi : ndarray (J,)
        Bounds of the *measured values* in this mode, error of the measurement included.
    products : tuple of (int, int)
        Pairs of measured parameters whose products are parameters too; their slopes follow those of the J measured.
    paced : ndarray (S,) int
        Measured parameter j for which the unknown is at most 1 - (change of theta_j over the step / reach_j)^2; -1: 1.
    reach : ndarray (J,)
        Largest change of each measured parameter over a step; empty where none is paced.
    more : dict
        Of the other matrices that depend on unknowns: name -> ndarray (S, rows, columns), the effects of the same s.
    """

    A_theta: Array = field(default=None)
    B_theta: Array = field(default=None)
    A_unc: Array = field(default=None)
    B_unc: Array = field(default=None)
    A_rad: Array = field(default=None)
    B_rad: Array = field(default=None)
    Bf_rad: Array = field(default=None)
    theta_lo: Array = field(default=None)
    theta_hi: Array = field(default=None)
    products: tuple[tuple[int, int], ...] = ()
    paced: Array = field(default=None)
    reach: Array = field(default=None)
    more: dict[str, Array] = field(default_factory=dict)

    @property
    def box(self) -> tuple[Array, Array]:
        """Bounds of the measured parameters and of their products, float64 to nearest; (J + products,) each."""
        lo, hi = with_products(self.theta_lo, self.theta_hi, self.products)
        return np.array(lo), np.array(hi)


def is_uncertain(plant: Plant) -> bool:
    """Whether the plant needs more than constant matrices per mode."""
    return plant.kind == "continuous" or bool(plant.theta) or plant.switching.late


def observed(plant: Plant) -> Plant:
    """Return the plant as the firmware sees it; the plant itself where nothing has to change.

    Parameters
    ----------
    plant : Plant

    Returns
    -------
    Plant
        Discrete; ``theta`` holds the measured parameters only.

    Raises
    ------
    DesignError
        The sampling period is far too long for a continuous plant.
    """
    if not is_uncertain(plant):
        return plant
    if plant.kind == "continuous":
        from .sampling import sampled
        return sampled(plant)
    measured = tuple(s for s in plant.theta if s.measured)
    return replace(plant, theta=measured, modes=tuple(_parts(plant, mode) for mode in plant.modes))


def _parts(plant: Plant, mode: Mode) -> UncertainMode:
    """Split the parameters of a discrete mode into measured ones, unknowns and measurement errors."""
    lo, hi = plant.theta_box(mode)
    known = np.array([s.measured for s in plant.theta], dtype=bool)
    error = np.array([s.error for s in plant.theta])
    middle, radius = (lo + hi) / 2, (hi - lo) / 2
    changed: dict[str, Array] = {}
    for name in SCHEDULED:
        slopes = np.array(mode.theta_terms.get(name, np.zeros((len(lo), *getattr(mode, name).shape))))
        changed[name] = getattr(mode, name) + np.einsum("j,jab->ab", np.where(known, 0.0, middle), slopes)
        changed[f"{name}_theta"] = slopes[known]
        sizes = np.where(known, error, radius)
        changed[f"{name}_unc"] = (sizes[:, None, None] * slopes)[sizes > 0]
        changed[f"{name}_rad"] = _slip(changed[name], slopes, middle, radius)
    more: dict[str, Array] = {}
    for name in set(mode.theta_terms) - set(SCHEDULED):
        slopes = np.array(mode.theta_terms[name])
        changed[name] = getattr(mode, name) + np.einsum("j,jab->ab", middle, slopes)
        more[name] = (radius[:, None, None] * slopes)[np.where(known, error, radius) > 0]
    box = {"theta_lo": (lo - error)[known], "theta_hi": (hi + error)[known]}
    plain = {k: getattr(mode, k) for k in ("name", "C", "D", "Bw", "Dw", "Dv", "Bf", "Df", "w_lo", "w_hi", "v_lo",
                                                "v_hi")}
    return UncertainMode(**plain | changed, **box, more=more, Bf_rad=np.zeros_like(mode.Bf))


def _slip(base: Array, slopes: Array, middle: Array, radius: Array) -> Array:
    """Bound on what the float64 arithmetic of ``_parts`` itself may have lost."""
    size = np.abs(base) + np.einsum("j,jab->ab", np.abs(middle) + radius, np.abs(slopes))
    return np.where(size > 0, 2.0**-48 * size, 0.0) if len(middle) else np.zeros_like(base)
