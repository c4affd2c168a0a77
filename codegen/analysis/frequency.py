"""What the residual of a polytopic observer makes of a sinusoid, with the weights held at one vertex.

Plant and observer side by side, as the plant's own equations and the tables say, neither taken apart into errors:

    E x+ = A x + B u + Bw w + Bf f,   y = C x + Dv v + Df f         (a continuous plant by Euler steps of the period)
    x_hat = z + T2 y,   r = y - C x_hat,   z+ = F x_hat + G u - K r,   out = M r

or, of an observer that solves the algebraic equations itself, x_hat = P z + Q u, z and u at the same sample.

Inputs are in units of their largest sizes. What is proved holds for weights that move; this shows where in frequency a
fault is seen: an observer that sees fast faults well may see none that lasts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from ..algebra.interval import sizes
from .panels import ALARM, EDGE
from .plots import WIDTH
from .svg import style

Array = np.ndarray
POINTS = 160
SLOWEST = 1e-4  # of the fastest frequency that samples can show


@dataclass(frozen=True)
class Responses:
    """Gains at each vertex and frequency.

    Parameters
    ----------
    frequency : ndarray (K,)
        Hz; per sample where the plant is discrete and has no period.
    unknown : ndarray (h, K)
        Largest gain from inputs, disturbances and noises to M r.
    fault : ndarray (h, K)
        Smallest gain from the faults to M r.
    """

    frequency: Array
    unknown: Array
    fault: Array


def responses(plant, t, seen: Array | None = None, faults: Array | None = None) -> Responses:
    """Gains of one observer.

    Parameters
    ----------
    plant : Plant
        With a polytope.
    t : PolytopicTables or Member of a bank
    seen : ndarray (p,) int, optional
        Outputs that the observer reads; all.
    faults : ndarray (k,) int, optional
        Faults that are looked at; all.

    Returns
    -------
    Responses
    """
    p, T = plant.polytope, plant.sample_period
    seen = np.arange(plant.n_y) if seen is None else seen
    faults = np.arange(plant.n_f) if faults is None else faults
    u, w, v, f = (sizes(*plant.limits(vector)) for vector in "uwvf")
    angle = np.pi * np.geomspace(SLOWEST, 1.0, POINTS)
    none = np.zeros((plant.n_y, plant.n_u + plant.n_w))
    out = []
    for j, vertex in enumerate(p.vertices):
        B = np.hstack([vertex.B * u, vertex.Bw * w, np.zeros((plant.n_x, plant.n_v)), vertex.Bf * f])
        D = np.hstack([none, p.Dv * v, p.Df * f])[seen]
        A = vertex.A
        if plant.kind == "continuous":
            A, B = p.E + T * A, T * B
        E, step, gain = _side_by_side(p.E, A, B, p.C[seen], D, t, j, u)
        values = [gain[0] @ np.linalg.solve(np.exp(1j * a) * E - step[0], step[1]) + gain[1] for a in angle]
        out.append(values)
    G = np.array(out)
    own = plant.n_u + plant.n_w + plant.n_v
    largest = np.linalg.svd(G[..., :own], compute_uv=False)[..., 0]
    return Responses(angle / (2 * np.pi * T), largest, _least(G[..., own + faults]))


def _least(G: Array) -> Array:
    """Smallest gain of a direction of the inputs: none where there are more of them than outputs."""
    if G.shape[-1] > G.shape[-2]:
        return np.zeros(G.shape[:2])
    return np.linalg.svd(G, compute_uv=False)[..., -1]


def _side_by_side(E: Array, A: Array, B: Array, C: Array, D: Array, t, j: int, u: Array):
    """E, (A, B) and (C, D) of plant and observer over (x, z); inputs as those of the plant, u first."""
    n = len(E)
    T2, Co, F, G, K, M = (np.asarray(a, dtype=float) for a in (t.T2, t.C, t.F[j], t.G[j], t.K[j], t.M))
    estimate, fed = np.hstack([T2 @ C, np.eye(n)]), T2 @ D
    if hasattr(t, "algebraic"):
        of_z, of_u = t.estimate(j)
        estimate, fed = np.hstack([np.zeros((n, n)), of_z]), np.hstack([of_u * u, np.zeros((n, D.shape[1] - len(u)))])
    r, direct = np.hstack([C, np.zeros((len(C), n))]) - Co @ estimate, D - Co @ fed
    zeros = np.zeros((n, n))
    step = np.vstack([np.hstack([A, zeros]), F @ estimate - K @ r])
    held = F @ fed - K @ direct
    held[:, :len(u)] += G * u
    return (np.block([[E, zeros], [zeros, np.eye(n)]]), (step, np.vstack([B, held])), (M @ r, M @ direct))


def frequency_figure(found: list[tuple[str, Responses]], fault: str, band: tuple[float, float] | None = None) -> Figure:
    """Draw the gains of observers, one panel each: unknown inputs (all vertices as a band) against faults.

    Parameters
    ----------
    found : list of (str, Responses)
        Name of the panel and what it shows.
    fault : str
        What the second band is called.
    band : (float, float), optional
        Hz up to which a smallest gain is certified, and that gain.

    Returns
    -------
    Figure
    """
    with style():
        figure = Figure(figsize=(WIDTH, 0.4 + 2.1 * len(found)), layout="constrained")
        axes = np.atleast_1d(figure.subplots(len(found), 1, sharex=True))
        for axis, (name, r) in zip(axes, found):
            for values, colour, label in ((r.unknown, EDGE, "inputs, disturbances, noises: largest"),
                                          (r.fault, ALARM, f"{fault}: smallest")):
                if np.any(values > 0):
                    axis.fill_between(r.frequency, values.min(axis=0), values.max(axis=0), color=colour, alpha=0.35,
                                      linewidth=0)
                    axis.plot(r.frequency, values.T, color=colour, linewidth=0.7)
                    axis.plot([], [], color=colour, label=label)
            if band is not None:
                axis.axvspan(r.frequency[0], band[0], color=ALARM, alpha=0.08, linewidth=0)
                axis.plot([r.frequency[0], band[0]], [band[1]] * 2, color=ALARM, linestyle="--", linewidth=0.9,
                          label=f"{fault}: certified")
            axis.set(xscale="log", yscale="log", ylabel="gain to the residual", title=name)
            axis.legend(loc="best")
        axes[-1].set_xlabel("frequency (Hz)")
    return figure
