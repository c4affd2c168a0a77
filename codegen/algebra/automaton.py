"""Which mode may follow which: switching as a graph, so that one set of inequalities per edge covers every sequence.

Arbitrary switching is the complete graph of the modes. An average dwell time is a leaky bucket (``certify.dwell``),
and its fill is a whole number: a node is then a mode with the fill that the bucket has left.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import DesignError

#: Most nodes that a design may have: every edge is a matrix inequality.
MOST = 120


@dataclass(frozen=True)
class Automaton:
    """Mode sequences as the paths of a graph.

    Parameters
    ----------
    mode : tuple of int
        Mode of each node.
    edges : tuple of (int, int)
        (node at sample k, node at sample k + 1).
    dwell : (int, int, int)
        add, drain, limit of the leaky bucket; zeros for arbitrary switching.
    """

    mode: tuple[int, ...]
    edges: tuple[tuple[int, int], ...]
    dwell: tuple[int, int, int] = (0, 0, 0)

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return 1 + max(self.mode)

    def after(self, node: int) -> list[int]:
        """Nodes that may follow."""
        return [b for a, b in self.edges if a == node]


def arbitrary(n_modes: int) -> Automaton:
    """Every mode after every mode.

    Parameters
    ----------
    n_modes : int

    Returns
    -------
    Automaton
    """
    nodes = range(n_modes)
    return Automaton(tuple(nodes), tuple((a, b) for a in nodes for b in nodes))


def dwell_time(n_modes: int, add: int, drain: int, limit: int) -> Automaton:
    """Average dwell time add/drain samples with chatter bound limit/add; limit = add is a minimum dwell time.

    Each sample takes ``drain`` out of the bucket and each switch puts ``add`` in, never more than ``limit``.

    Parameters
    ----------
    n_modes : int
    add, drain, limit : int

    Returns
    -------
    Automaton
        One node per mode and fill left after draining, those that are reached from an empty bucket.

    Raises
    ------
    DesignError
        More nodes than a design can have.
    """
    fills, edges, todo = {0}, [], [0]
    while todo:
        fill = todo.pop()
        moves = [(False, fill)] + ([(True, fill + add)] if fill + add <= limit else [])
        for switch, level in moves:
            left = max(level - drain, 0)
            edges.append((fill, left, switch))
            if left not in fills:
                fills.add(left)
                todo.append(left)
    if len(fills) * n_modes > MOST:
        raise DesignError(f"switching: a dwell time of {add}/{drain} samples with {n_modes} modes needs "
                          f"{len(fills) * n_modes} Lyapunov matrices (at most {MOST}). State a shorter dwell time, "
                          "which this plant then meets too, or none.")
    nodes = [(q, fill) for q in range(n_modes) for fill in sorted(fills)]
    index = {node: i for i, node in enumerate(nodes)}
    pairs = [(index[q, a], index[r, b]) for q in range(n_modes) for a, b, switch in edges
             for r in range(n_modes) if (r != q) == switch]
    return Automaton(tuple(q for q, _ in nodes), tuple(sorted(pairs)), (add, drain, limit))
