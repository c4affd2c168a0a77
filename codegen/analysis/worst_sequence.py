"""A switching sequence, an uncertainty and a disturbance that bring a switched system near its certified energy gain.

The other side of ``certify.switched_gain``: what is found here was run, so no level below it can be true. Backwards in
time the most that the future can still yield from a state, ``sup sum |z|^2 - g |d|^2 = x' V x``, follows a Riccati step
per mode; where ``g I - E' V E - F' F`` stops being positive the gain from rest exceeds sqrt(g). A beam of the most
promising continuations is kept at every node, and g is found by bisection. The disturbance is then played forwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class WorstRun:
    """A run from rest.

    Parameters
    ----------
    gain : float
        sqrt(sum |z|^2 / sum |d|^2) of this run.
    nodes : ndarray (K,) int
        Node of the switching graph at each sample.
    vertex : ndarray (K,) int
        Which corner of the uncertainty.
    d : ndarray (K, n_d), z : ndarray (K, n_f)
    """

    gain: float
    nodes: Array
    vertex: Array
    d: Array
    z: Array


@dataclass(frozen=True)
class Loop:
    """Plant and filter in one mode at one corner of its uncertainty: x+ = A x + E d, z = C x + F d."""

    A: Array
    E: Array
    C: Array
    F: Array


def corners(m, gains, samples: int = 0, seed: int = 0) -> list[Loop]:
    """Loops of one mode at the ends of its repeated numbers, full blocks at zero or at random.

    Parameters
    ----------
    m : FilterMode
    gains : (A, B, C, D) of the filter
    samples : int
        Random full blocks of norm one beside zero.
    seed : int

    Returns
    -------
    list of Loop
    """
    rng = np.random.default_rng(seed)
    n, (A, B, C, D) = len(m.A), (np.asarray(g, dtype=float) for g in gains)
    choices = []
    for b in m.blocks:
        shape = (b.H.shape[1], len(b.S))
        if b.repeated:
            choices.append([np.eye(*shape), -np.eye(*shape)])
            continue
        drawn = [np.linalg.svd(rng.standard_normal(shape), full_matrices=False) for _ in range(samples)]
        choices.append([np.zeros(shape)] + [U @ V for U, _, V in drawn])
    out = []
    for deltas in product(*choices):
        M = np.block([[m.A, m.E], [m.C, m.F]])
        for b, delta in zip(m.blocks, deltas):
            M = M + b.H @ delta @ b.S
        A0, E0, C0, F0 = M[:n, :n], M[:n, n:], M[n:, :n], M[n:, n:]
        out.append(Loop(np.block([[A0, np.zeros((n, len(A)))], [B @ C0, A]]), np.vstack([E0, B @ F0]),
                        np.hstack([D @ C0 + m.Cz, C]), D @ F0 + m.Fz))
    return out


class Search:
    """Beam search over the paths of a switching graph, backwards.

    Parameters
    ----------
    loops : sequence of list of Loop
        Per mode.
    switching : Automaton
    steps : int
        Longest run.
    beam : int
        Continuations kept per node.
    """

    def __init__(self, loops, switching, steps: int = 150, beam: int = 12):
        self.switching, self.steps, self.beam = switching, steps, beam
        self.first = np.cumsum([0] + [len(group) for group in loops])[:-1]
        every = [loop for group in loops for loop in group]
        self.A, self.E, self.C, self.F = (np.stack([getattr(x, k) for x in every]) for k in "AECF")
        self.before = {b: [a for a, c in switching.edges if c == b] for b in range(len(switching.mode))}
        self.choices = {a: np.arange(len(loops[q])) + self.first[q] for a, q in enumerate(switching.mode)}
        self.reach = self._reach()

    def _reach(self) -> Array:
        """What disturbances reach while one loop stays, summed over the loops: a scale for states."""
        W = np.zeros_like(self.A)
        for _ in range(60):
            W = self.A @ W @ self.A.transpose(0, 2, 1) + self.E @ self.E.transpose(0, 2, 1)
        return W.sum(axis=0)

    def exceeds(self, g: float) -> list[int] | None:
        """A path whose gain from rest exceeds sqrt(g), as (node, loop) from its first sample on; None: not found."""
        n = self.A.shape[1]
        beams = {a: (np.zeros((1, n, n)), [()]) for a in self.before}
        for _ in range(self.steps):
            fresh: dict = {a: ([], []) for a in self.before}
            for b, (V, paths) in beams.items():
                for a in self.before[b]:
                    for i in self.choices[a]:
                        new, slack = self._step(V, i, g)
                        worst = int(np.argmin(slack))
                        if slack[worst] <= 0:
                            return [(a, int(i)), *paths_of(paths[worst])]
                        fresh[a][0].append(new)
                        fresh[a][1].extend([((a, int(i)), path) for path in paths])
            beams = {a: self._keep(np.concatenate(V), paths) for a, (V, paths) in fresh.items() if V}
        return None

    def _step(self, V: Array, i: int, g: float) -> tuple[Array, Array]:
        """Riccati step of a stack, and the least eigenvalue of what must stay positive."""
        A, E, C, F = self.A[i], self.E[i], self.C[i], self.F[i]
        VE = V @ E
        inner = g * np.eye(E.shape[1]) - E.T @ VE - F.T @ F
        slack = np.linalg.eigvalsh(inner)[:, 0]
        if np.min(slack) <= 0:
            return V, slack
        cross = A.T @ VE + C.T @ F
        new = A.T @ V @ A + C.T @ C + cross @ np.linalg.solve(inner, cross.transpose(0, 2, 1))
        return (new + new.transpose(0, 2, 1)) / 2, slack

    def _keep(self, V: Array, paths: list) -> tuple[Array, list]:
        """The most promising: half by what one disturbance can do now, half by the size at large."""
        now = np.linalg.eigvalsh(self.E.transpose(0, 2, 1)[None] @ V[:, None] @ self.E[None])[..., -1].max(axis=1)
        size = np.einsum("kab,ba->k", V, self.reach)
        half = self.beam // 2
        chosen = list(np.argsort(-now)[:half]) + list(np.argsort(-size)[:half])
        chosen = list(dict.fromkeys(int(i) for i in chosen))
        return V[chosen], [paths[i] for i in chosen]

    def play(self, path: list, g: float) -> WorstRun:
        """Worst disturbance of a path, forwards from rest."""
        n, n_d = self.E.shape[1:]
        V, laws = np.zeros((n, n)), []
        for _, i in reversed(path):
            A, E, C, F = self.A[i], self.E[i], self.C[i], self.F[i]
            inner = g * np.eye(n_d) - E.T @ V @ E - F.T @ F
            cross = A.T @ V @ E + C.T @ F
            laws.append((inner, cross))
            V = A.T @ V @ A + C.T @ C + cross @ np.linalg.solve(inner, cross.T)
        laws.reverse()
        d = np.zeros((len(path), n_d))
        z = np.zeros((len(path), self.C.shape[1]))
        x = np.zeros(n)
        for k, (_, i) in enumerate(path):
            inner, cross = laws[k]
            d[k] = np.linalg.eigh(inner)[1][:, 0] if k == 0 else np.linalg.solve(inner, cross.T @ x)
            z[k] = self.C[i] @ x + self.F[i] @ d[k]
            x = self.A[i] @ x + self.E[i] @ d[k]
        first = self.first[[self.switching.mode[a] for a, _ in path]]
        return WorstRun(float(np.sqrt(np.sum(z**2) / np.sum(d**2))), np.array([a for a, _ in path]),
                        np.array([i for _, i in path]) - first, d, z)


def paths_of(path) -> list:
    """The (node, loop) pairs of a linked path."""
    out = []
    while path:
        out.append(path[0])
        path = path[1]
    return out


def worst_run(modes, gains, switching, above: float, steps: int = 150, beam: int = 12, samples: int = 0) -> WorstRun:
    """Find a run whose gain comes near the certified one.

    Parameters
    ----------
    modes : sequence of FilterMode
    gains : sequence of (A, B, C, D), one per mode
    switching : Automaton
    above : float
        A certified gain: nothing larger needs to be tried.
    steps, beam : int
    samples : int
        Random corners of each full block.

    Returns
    -------
    WorstRun
        Of the largest gain found; its disturbance, sequence and corner can be run again.
    """
    search = Search([corners(m, g, samples) for m, g in zip(modes, gains)], switching, steps, beam)
    low, high, best = 0.0, above, None
    while high - low > 1e-4 * high:
        middle = (low + high) / 2
        path = search.exceeds(middle**2)
        if path is None:
            high = middle
            continue
        run = search.play(path, middle**2)
        best = run if best is None or run.gain > best.gain else best
        low = max(middle, min(run.gain, high * (1 - 1e-5)))
    return best
