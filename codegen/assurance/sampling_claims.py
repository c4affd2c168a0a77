"""What is claimed of the time between the samples of a continuous plant with constant matrices at its samples."""

from __future__ import annotations

from collections.abc import Callable, Iterator

#: Constants that rest on it: of a filter, else of a point observer.
CONSTANTS = {"filter": ("M", "G", "L", "K", "Du", "Dy", "h")}
ESTIMATE = ("M", "G", "L", "N", "d", "A", "B", "a")


def entries(design) -> tuple[str, ...]:
    """Entries of the plant file that a sampled plant comes from, beside those of every design."""
    enclosed = hasattr(next(iter(design.observer.tables.values())), "shape") or design.observer.family == "filter"
    if design.plant.kind != "continuous" or not enclosed:
        return ()
    return ("time.kind", "time.sample_period", "observer.sampling", "Bf", "signals.f", "signals.theta")


def of_certificate(design, t, build: type, plant: tuple, own: tuple) -> Iterator[tuple[str, Callable]]:
    """Yield (beginning of the sentence, what makes its claim), where there is such a claim.

    Parameters
    ----------
    design : Design
    t : PointTables or FilterTables
    build : type
        ``claims.Claim``.
    plant : tuple of str
        Entries of the plant file that it comes from.
    own : tuple of str
        Checks by exact arithmetic.
    """
    if not entries(design):
        return
    yield "between samples, ", lambda text: build(
        "sampling", text, plant, "The tables are proved for a discrete plant with constant matrices whose bounded "
        "disturbance holds all that these leave out of the continuous one over a period, for x, u and f in their "
        "ranges.", "x(h) = Phi x + integral of Phi (B u + Bw w + Bf f); |x(h) - A x - B u - Bf f - Bw mean(w)| <= "
        "rest: A_rad |x| + B_rad |u| + Bf_rad |f| + what w and u move (Peano and Baker, order by order, with the tail)",
        "own derivation: the discrete plant of a continuous one at its sampling period, with constant matrices",
        "codegen.plant.enclosed.enclosed", CONSTANTS.get(design.observer.family, ESTIMATE), (), (*own, "validation"))
