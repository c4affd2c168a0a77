"""A tracking law beside a polytopic observer in a view: its sums, limits and words of the header."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .cprint import Term, count_operations, literal, product, sum_lines
from .manual import Channel
from .maps import Names, Table
from .parts import Operations, vector_table

Array = np.ndarray


@dataclass(frozen=True)
class LawView:
    """Statements and tables of a law; ``varies`` has one entry or none, ``spare`` fills the struct of the law.

    ``accepted`` are conditions on ref, ``operations`` what the dearest call takes, ``cost`` the same in words.
    """

    refs: tuple[Channel, ...]
    accepted: tuple[str, ...]
    inputs: tuple[str, ...]
    integral: tuple[str, ...]
    varies: tuple[str, ...]
    spare: tuple[str, ...]
    ends: tuple[Table, ...]
    limits: tuple[Table, ...]
    operations: Operations
    cost: str


def law_view(t, names: Names, outputs: tuple[Channel, ...], observer: Operations) -> LawView:
    """Decide everything about the C of a law.

    Parameters
    ----------
    t : PolytopicTables
        With a law.
    names : Names
    outputs : tuple of Channel
        Of y.
    observer : Operations
        Of its step, and of the estimate and its weights once more.

    Returns
    -------
    LawView
    """
    law, m, real = t.law, names.macro, t.real
    (_, inputs, n), k = law.Kx.shape, len(law.rows)
    operands = [*(f"x_hat[{i}]" for i in range(n)), *(f"law->s[{i}]" for i in range(k))]
    lines, sums = [], []
    for i in range(inputs):
        row = _terms(np.where(law.shared[i], law.gains[0, i], 0), operands, real)
        for j, M in enumerate(law.gains):
            own = _terms(np.where(law.shared[i], 0, M[i]), operands, real)
            if own:
                lines.append(_statement(f"v[{j}]", own, real))
                row.append(("+", f"(h[{j}] * v[{j}])"))
                sums.append(own)
        lines.append(_statement(f"in->u[{i}]", row, real))
        sums.append(row)
    T = literal(law.period, real)
    integral = tuple(f"next[{i}] = law->s[{i}] + ({T} * (ref[{i}] - in->y[{r}]));" for i, r in enumerate(law.rows))
    multiply, add = (sum(count_operations(terms)[c] for terms in sums) for c in (0, 1))
    done = observer + Operations(multiply + k, add + 2 * k, 2 * (2 * k + inputs + len(t.y_lo)))
    divisions = f"{done.divide} divisions, " * bool(done.divide)
    most = [literal(v, real) for v in law.reference]
    refs = tuple(Channel(i, outputs[r].macro, outputs[r].name, f"ref[{i}]: {outputs[r].name}, -{a} to {a}")
                 for i, (r, a) in enumerate(zip(law.rows, most)))
    return LawView(
        refs=refs, accepted=tuple(f"(ref[{i}] >= -{a}) && (ref[{i}] <= {a})" for i, a in enumerate(most)),
        inputs=tuple(lines), integral=integral, varies=("",) * (not law.shared.all()),
        spare=("",) * (real == "float64"),
        ends=(vector_table("least", f"{m}_NU", t.u_lo, real), vector_table("most", f"{m}_NU", t.u_hi, real)),
        limits=(vector_table("limit", f"{m}_NREF", law.limit, real),),
        operations=done, cost=f"{done.multiply} multiplications, {divisions}{done.add} additions and {done.compare} "
                              "comparisons of real numbers")


def _terms(row: Array, operands: list[str], real: str) -> list[Term]:
    return [term for c, name in zip(row, operands) for term in product(float(c), name, real)]


def _statement(target: str, terms: list[Term], real: str) -> str:
    return f"{target} = " + "\n        ".join(sum_lines(terms, real)) + ";"
