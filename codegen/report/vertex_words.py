"""A polytopic plant in words: its equation, its vertices, what their weights read, and what is known beside them."""

from __future__ import annotations

import numpy as np

from ..plant.model import Plant
from . import words
from .table import Fact, Table, table


def model(plant: Plant) -> str:
    """The equation that the vertices share.

    Parameters
    ----------
    plant : Plant
        With a polytope.

    Returns
    -------
    text : str
    """
    p, left = plant.polytope, "x′" if plant.kind == "continuous" else "x⁺"
    plain = np.array_equal(p.E, np.eye(plant.n_x))
    constant = " + c" if any(np.any(v.offset) for v in p.vertices) else ""
    return (f"{'' if plain else 'E '}{left} = sum over the vertices j of h_j (A x + B u + Bw w + Bf f{constant})"
            f"{' + g' if p.known else ''}, y = C x + D u + Dv v + Df f")


def facts(plant: Plant) -> tuple[Fact, ...]:
    """Say what the vertices and their weights h_j are.

    Parameters
    ----------
    plant : Plant
        With a polytope.

    Returns
    -------
    tuple of Fact
    """
    p = plant.polytope
    short = plant.n_x - int(np.linalg.matrix_rank(p.E))
    solved = [Fact("Algebraic equations", f"{short}: E has rank {plant.n_x - short} of {plant.n_x}")] if short else []
    if p.premises:
        source = (f"the equations of the plant file, exactly: products of {words.count(len(p.premises), 'term')} that "
                  "the vertices take at their bounds")
    elif p.equations:
        source = "the equations of the plant file, linearised at points; nothing bounds what that misses between them"
    else:
        source = "the plant file, with the weights that it states"
    return *solved, Fact("Vertices", f"{len(p.vertices)}, from {source}")


def tables(plant: Plant) -> tuple[Table, ...]:
    """List what the weights read and what is known beside the vertices.

    Parameters
    ----------
    plant : Plant
        With a polytope.

    Returns
    -------
    tuple of Table
    """
    p, out = plant.polytope, []
    if p.premises:
        out.append(table("Terms that the weights are made of", ("name", "term", "range"), [
            (z.name, _formula(z.term), words.interval(z.lo, z.hi, "")) for z in p.premises]))
    if p.raw:
        out.append(table("Weights of the vertices", ("vertex", "before all are divided by their sum"), [
            (v.name, _formula(w)) for v, w in zip(p.vertices, p.raw)]))
    if p.known:
        out.append(table("Known at run time: g, which is in no vertex", ("equation", "term", "range"), [
            (f"{k.row + 1}", _formula(k.term), words.interval(k.lo, k.hi, "")) for k in p.known]))
    return tuple(out)


def _formula(term) -> str:
    return str(term.evalf(6))
