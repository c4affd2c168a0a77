"""An observer that solves the algebraic equations itself, as C: what it has beside a polytopic one."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from ..observers.descriptor_tables import DescriptorTables
from . import polytopic_parts
from .cprint import count_operations, literal
from .maps import Names
from .parts import Operations, Parts
from .polytopic_parts import PolytopicView, statement, terms_of

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class DescriptorView(PolytopicView):
    """Also: ``solve``, statements that fill h and x_hat; ``local`` what they declare; ``means`` words of their mean;
    ``letter`` of its weights; ``named`` the algebraic states; ``given``, ``passed`` the parameter ``in``.
    """

    solve: tuple[str, ...]
    local: tuple[str, ...]
    means: tuple[str, ...]
    letter: str
    named: str
    given: str
    passed: str


def parts(t: DescriptorTables, s, names: Names, signals: tuple) -> Parts:
    """Decide what is this observer's own.

    Parameters
    ----------
    t : DescriptorTables
    s : Supervision
    names : Names
    signals : tuple of tuple of Channel
        x, u, y and measured parameters.

    Returns
    -------
    Parts
    """
    base = polytopic_parts.parts(t, s, names, signals)
    view = base.sets[0]
    lines, sums, blended = solve(t)
    reads = bool(view.called) or any("in->" in line for line in lines)
    declared = [f"{names.real_type} {name}[{names.macro}_NH]; /* {note} */" for name, note, wanted in (
        ("g", "weights of the solved equations", t.uneven), ("v", "what each vertex says", blended)) if wanted]
    declared += [f"{names.real_type} pivot;"] * t.uneven
    named = ", ".join(f"x_hat[{k}] {signals[0][k].name}" for k in t.algebraic)
    means = ("with weights h[j]: the mean of all algebraic equations holds.",)
    if t.uneven:
        means = ("with weights g[j] = h[j] d_j / pivot, d_j the factor of the equations at vertex j: so the mean of",
                 "all equations holds. pivot is the mean of the d_j: above its guard, half the least of them.")
    idle = [f"(void){name};" for name, word in (("in", "in->"), ("h", "h[")) if not any(word in x for x in view.move)]
    own = DescriptorView(
        **{f.name: getattr(view, f.name) for f in fields(view) if f.name != "idle"}, idle=tuple(idle), solve=lines,
        local=tuple(declared), means=means, letter="g" if t.uneven else "h", named=named,
        given=f"const {names.prefix}_in *in, " if reads else "", passed="in, " if reads else "")
    counts = [count_operations(terms) for terms in sums]
    multiply, add = (sum(c[k] for c in counts) for k in (0, 1))
    o, h = base.operations, len(t.pivot)
    uneven = Operations(int(np.count_nonzero(t.pivot != 1)), h - 1, 1, h) if t.uneven else Operations(0, 0, 0)
    own_operations = o + Operations(multiply, add, 0) + uneven
    return replace(base, header="descriptor.h.jinja", sets=(own,), operations=own_operations)


def solve(t: DescriptorTables) -> tuple[tuple[str, ...], list, bool]:
    """Print g and x_hat; the terms of every sum; whether something differs between the vertices.

    Parameters
    ----------
    t : DescriptorTables
    """
    n, m, real = len(t.z0), t.Q.shape[2], t.real
    operands = [*(f"s->z[{k}]" for k in range(n)), *(f"in->u[{k}]" for k in range(m))]
    g, lines, sums, blended = "g" if t.uneven else "h", [], [], False
    if t.uneven:
        h, least = range(len(t.pivot)), literal(float(t.least_pivot), real)
        lines += [f"g[{j}] = {' * '.join([f'h[{j}]', *([literal(float(d), real)] if d != 1 else [])])};"
                  for j, d in zip(h, t.pivot)]
        lines.append("pivot = " + " + ".join(f"g[{j}]" for j in h) + ";")
        lines.append(f"pivot = (pivot > {least}) ? pivot : {least};")
        lines += [f"g[{j}] = g[{j}] / pivot;" for j in h]
    for i in range(n):
        if i not in t.algebraic:
            lines.append(f"x_hat[{i}] = s->z[{i}];")
            continue
        k = t.algebraic.index(i)
        row = terms_of(np.where(t.common[k], t.solved[0, k], 0), operands, real)
        for j, M in enumerate(t.solved):
            own = terms_of(np.where(t.common[k], 0, M[k]), operands, real)
            if own:
                blended = True
                sums.append(own)
                lines.append(statement(f"v[{j}]", own, real))
                row.append(("+", f"({g}[{j}] * v[{j}])"))
        sums.append(row)
        lines.append(statement(f"x_hat[{i}]", row, real))
    return tuple(lines), sums, blended
