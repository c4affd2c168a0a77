"""What is proved of ``mode-sliding``: the conditions of Theorem 12 on its gains, and that a pair holds x in its mode.

The gains of continuous time are judged in rational numbers; that the tables have them, held for a period, and that
each pair's offsets cover its mode, in ball arithmetic. What rounding can do is gamma_k = k u / (1 - k u) times the
magnitudes of the terms (u the unit roundoff, k roundings in a row; fused or not). Of the decision nothing is proved.
"""

from __future__ import annotations

import numpy as np
from flint import arb, ctx, fmpq

from ..errors import CertificateError
from .exact import Q, eye, leading_failure, product, rational, zeros
from .mode_enclosure import PIECES, PRECISION, ball, exponential, size

Array = np.ndarray
SIDES = ("hi", "lo")
#: Relative room of the widths that are stored.
ROOM = 1e-9


def prove(plant, t, found: dict, limit: float, target: float) -> dict:
    """Certify tables.

    Parameters
    ----------
    plant : Plant
    t : SlidingTables
    found : dict
        "L_hi", "L_lo" (N, n_x, n_y), "P" (2, n_x), "gamma", "beta" (N,).
    limit, target : float
        Of the gains, 1/s; every entry of J.

    Returns
    -------
    dict
        ``check`` accepts it.

    Raises
    ------
    CertificateError
    """
    cert = {"kind": "sliding", "limit": limit, "target": target, "dwell": t.dwell, "blank": t.blank,
            **{k: np.asarray(found[k]).tolist() for k in ("L_hi", "L_lo", "P")}}
    cert["gamma"], cert["beta"] = (_levels(plant, cert, found[name], name) for name in ("gamma", "beta"))
    cert["errors"] = [[settled(t, q, side, slack).tolist() for side, slack in zip(SIDES, slacks)]
                      for q, slacks in enumerate(demands(plant, t))]
    check(plant, t, cert)
    return cert


def _levels(plant, cert: dict, start, name: str) -> list[float]:
    """Smallest of a few levels above the solver's that the gains have, per mode.

    Raises
    ------
    CertificateError
    """
    levels = []
    for q, (mode, value) in enumerate(zip(plant.modes, start)):
        tries = [float(value) * (1 + room) for room in (0.0, 1e-6, 1e-4, 1e-2, 0.1)]
        level = next((x for x in tries if leading_failure(-conditions(mode, cert, q, {name: x})[name]) is None),
                     None)
        if level is None:
            raise CertificateError(f'certificate: in mode "{mode.name}" the gains do not have the level {name} that '
                                   "the solver states. Take another observer.gain_limit.")
        levels.append(level)
    return levels


def conditions(mode, cert: dict, q: int, levels: dict) -> dict[str, Array]:
    """Matrices of Theorem 12 that are to be negative definite, exactly: "gamma", "beta" of those given."""
    A, C, n = rational(mode.A), rational(mode.C), len(mode.A)
    P = [rational(np.array(p)) for p in cert["P"]]
    D = [np.array([[P[s][i] if i == j else fmpq(0) for j in range(n)] for i in range(n)], dtype=object)
         for s in range(2)]
    up, down = (np.vectorize(lambda x, s=s: max(s * x, fmpq(0)), otypes=[object])(C) for s in (1, -1))
    seen = np.block([[up, down], [-down, -up]])
    S = product(seen.T, seen)
    for s, side in enumerate(SIDES):
        closed = product(D[s], A - product(rational(np.array(cert[f"L_{side}"][q])), C))
        own = slice(s * n, (s + 1) * n)
        S[own, own] = S[own, own] + closed + closed.T
    J = zeros(2 * len(C), n) + Q(cert["target"])
    whole = np.block([[D[0], zeros(n, n)], [zeros(n, n), D[1]]])
    told = np.vstack([D[0], -D[1]]) - product(seen.T, J)
    out = {}
    if "gamma" in levels:
        out["gamma"] = np.block([[S, whole], [whole, -Q(levels["gamma"]) * eye(2 * n)]])
    if "beta" in levels:
        out["beta"] = np.block([[S, told], [told.T, product(J.T, J) - Q(levels["beta"]) * eye(n)]])
    return out


def check(plant, t, cert: dict) -> list[str]:
    """Re-check a certificate; return what is proved, one sentence per claim.

    Raises
    ------
    CertificateError
        Naming the condition, the mode or the constant.
    """
    rooms(plant, t, cert)
    return sentences(plant, t, cert)


def rooms(plant, t, cert: dict) -> list[tuple[str, fmpq, str]]:
    """Check every condition; return of each its kind, what is left of it at least, and where.

    Raises
    ------
    CertificateError
        Naming the condition, the mode or the constant.
    """
    left: list[tuple[str, fmpq, str]] = []
    beyond = Q(plant.switching.average_dwell) * (1 + fmpq(1, 10**8)) - t.dwell * Q(plant.sample_period)
    if (t.dwell, t.blank) != (cert["dwell"], cert["blank"]) or beyond < 0:
        raise CertificateError(f"certificate: the dwell time of the tables is {t.dwell} samples, that of the plant "
                               f"{plant.switching.average_dwell:g} s. Design again.")
    left.append(("dwell", beyond, ""))
    check_theorem(plant, cert)
    check_held(plant, t, cert, left)
    for q, slacks in enumerate(demands(plant, t, left)):
        for side, slack, given in zip(SIDES, slacks, cert["errors"][q]):
            M, e = ball(getattr(t, f"M_{side}")[q]), ball(np.array(given))
            for i, after in enumerate(M @ e + slack):
                where = f'x_{side}[{i}], mode "{plant.modes[q].name}"'
                _note(left, "error", e[i] - after, where, f'in mode "{plant.modes[q].name}" the error {i} of x_{side} '
                      f"does not settle within {given[i]:.6g}.")
    return left


def _note(left: list, kind: str, room, where: str, why: str) -> None:
    """Refuse what is not surely at least zero; keep how much it is at least.

    Raises
    ------
    CertificateError
    """
    if not room >= 0:
        raise CertificateError(f"certificate: {why}")
    mantissa, exponent = room.lower().man_exp()
    left.append((kind, fmpq(mantissa) * fmpq(2) ** exponent, where))


def check_theorem(plant, cert: dict) -> None:
    """The conditions of Theorem 12 on the gains, exactly.

    Raises
    ------
    CertificateError
    """
    if min(Q(x) for p in cert["P"] for x in p) < 1:
        raise CertificateError(f"certificate: P is {cert['P']} (found), expected no entry below 1.")
    for q, mode in enumerate(plant.modes):
        value, where = min(off_diagonal(mode, cert, q), key=lambda case: case[0])
        if value < 0:
            raise CertificateError(f"certificate: entry {where} is {float(value - Q(cert['limit'])):.6g} on the "
                                   f"diagonal, or {float(value):.6g} off it: not Metzler within the limit "
                                   "of the gains.")
        levels = {name: cert[name][q] for name in ("gamma", "beta")}
        for name, matrix in conditions(mode, cert, q, levels).items():
            if leading_failure(-matrix) is not None:
                raise CertificateError(f'certificate: the level {name} = {levels[name]:.6g} of mode "{mode.name}" is '
                                       "not that of its gains.")


def off_diagonal(mode, cert: dict, q: int) -> list[tuple[fmpq, str]]:
    """Entries of A - L C + limit I of one mode, none of which may be negative, each with its place."""
    out = []
    for side in SIDES:
        closed = rational(mode.A) - product(rational(np.array(cert[f"L_{side}"][q])), rational(mode.C))
        out += [(x, f'[{i}][{j}] of A - L_{side} C in mode "{mode.name}"')
                for (i, j), x in np.ndenumerate(closed + Q(cert["limit"]) * eye(len(closed)))]
    return out


def demands(plant, t, left: list | None = None) -> list[tuple[Array, Array]]:
    """Demand that tables hold the plant; per mode what the errors of its bounds gain in a step at most, per side.

    What is left of each demand goes into ``left`` (see ``rooms``).

    Raises
    ------
    CertificateError
        Naming the constant.
    """
    with ctx.workprec(PRECISION):
        return _Demands(plant, t, [] if left is None else left).all()


def halves(lo: Array, hi: Array) -> tuple[Array, Array]:
    """Middle and half width of ranges given by floats: as numbers, for a radius of a ball has few digits."""
    a, b = ball(lo), ball(hi)
    return (a + b) / 2, (b - a) / 2


def wide_of(A: Array, b: Array) -> Array:
    """[A, b; 0, 0], whose exponential has the integral of e^{A s} b."""
    whole = ball(np.zeros((len(A) + 1, len(A) + 1)))
    whole[:-1, :-1], whole[:-1, -1] = A, b
    return whole


class _Demands:
    """The demands on one pair of plant and tables."""

    def __init__(self, plant, t, left: list):
        self.plant, self.t, self.left = plant, t, left
        self.n, self.n_u, self.p = plant.n_x, plant.n_u, plant.n_y
        self.T, self.unit = arb(float(plant.sample_period)), arb(float(np.finfo(t.real).eps)) / 2
        self.tiny = arb(float(np.finfo(t.real).smallest_subnormal)) * (4 * (self.n + self.n_u + self.p) + 16)
        first = plant.modes[0]
        self.C, self.far = ball(first.C), ball(t.limit)
        self.x, self.u = halves(*plant.limits("x")), halves(*plant.limits("u"))
        self.noise = self.spread(ball(first.Dv), halves(first.v_lo, first.v_hi))
        self.x_size, self.u_size, y = (size(m) + size(h) for m, h in (self.x, self.u, halves(*plant.limits("y"))))
        # s = y - D u as the C computes it, from what it reads of y and u.
        fed = self.times(size(ball(t.D)), self.u_size)
        self.lost = (self.gamma(self.n_u + 3) * (y + fed) + self.times(size(ball(first.D) - ball(t.D)), self.u_size)
                     + self.tiny)
        self.seen = y + fed + self.lost

    @staticmethod
    def times(A: Array, x: Array) -> Array:
        """A x; zeros where there is nothing to sum."""
        return A @ x if A.shape[1] else np.array([arb(0)] * A.shape[0], dtype=object)

    def spread(self, A: Array, x: tuple[Array, Array]) -> tuple[Array, Array]:
        """Middle and half width of A x for x within a range."""
        return self.times(A, x[0]), self.times(size(A), x[1])

    def gamma(self, k: int) -> arb:
        """Bound of the relative error of k roundings in a row."""
        return k * self.unit / (1 - k * self.unit)

    def all(self) -> list[tuple[Array, Array]]:
        """Every demand."""
        t, H = self.t, ball(self.t.H)
        for i in range(self.n):
            _note(self.left, "limit", self.far[i] - self.x_size[i], f"state {i}",
                  f"limit[{i}] is below the range of x.")
        apart = self.times(size(self.C - H), self.x_size) + self.lost + self.tiny
        for i in range(self.p):
            for side, given, sign in (("v_hi", t.v_hi, 1), ("v_lo", t.v_lo, -1)):
                value = ball(given)[i]
                terms = (self.times(size(H), self.far)[i] + self.seen[i] + abs(value)) * self.gamma(self.n + 4)
                needed = sign * self.noise[0][i] + self.noise[1][i] + apart[i] + terms
                _note(self.left, "test", sign * value - needed, f"{side}[{i}]", f"{side}[{i}] is "
                      f"{float(given[i]):.9g}: the true mode's test could fail. Design again.")
        return [self.of_mode(q) for q in range(len(self.plant.modes))]

    def of_mode(self, q: int) -> tuple[Array, Array]:
        """The offsets of one mode."""
        m, wide = self.plant.modes[q], self.n + self.n_u
        whole = ball(np.zeros((wide, wide)))
        whole[:self.n, :self.n], whole[:self.n, self.n:] = ball(m.A), ball(m.B)
        move = exponential(whole, self.T)[:self.n]
        pushed = self.spread(ball(m.Bw), halves(m.w_lo, m.w_hi))
        steps = [arb(float(((2 * k + 1) * self.T / (2 * PIECES)).mid()), float((self.T / PIECES).abs_upper()) * 0.5001)
                 for k in range(PIECES)]
        # int e^{A s} (middle + w(s)) ds: w anywhere within its half width at every s
        fixed = exponential(wide_of(ball(m.A), pushed[0]), self.T)[:self.n, self.n]
        w = fixed, sum(size(exponential(ball(m.A), s)) @ pushed[1] for s in steps) * (self.T / PIECES)
        return tuple(self.side(q, side, move, w) for side in SIDES)

    def side(self, q: int, side: str, move: Array, w: Array) -> Array:
        """One offset, and what the error of its bound gains at most."""
        t, sign = self.t, 1 if side == "hi" else -1
        M, L, d = (ball(getattr(t, f"{k}_{side}")[q]) for k in "MLd")
        G = ball(t.G[q])
        if np.any(getattr(t, f"M_{side}")[q] < 0):
            raise CertificateError(f'certificate: M_{side} of mode "{self.plant.modes[q].name}" has an entry below '
                                   "zero.")
        parts = (self.spread(move[:, :self.n] - M - L @ self.C, self.x), self.spread(move[:, self.n:] - G, self.u), w,
                 self.spread(-L, self.noise))
        middle, half = (sum(p[k] for p in parts) for k in range(2))
        terms = M @ self.far + self.times(size(G), self.u_size) + size(L) @ self.seen + size(d)
        lost = self.gamma(self.n + self.n_u + self.p + 3) * terms + size(L) @ self.lost + self.tiny
        slack = []
        for i in range(self.n):
            where = f'd_{side}[{i}] of mode "{self.plant.modes[q].name}"'
            _note(self.left, "offset", sign * d[i] - (sign * middle[i] + half[i] + lost[i]), where,
                  f"{where} is {float(d[i].mid()):.9g}, not far enough: x could leave. Design again.")
            slack.append((sign * d[i] - sign * middle[i] + half[i] + lost[i]).upper())
        return np.array(slack, dtype=object)


def check_held(plant, t, cert: dict, left: list) -> None:
    """The gains of the tables are those of the certificate, held for a period; see ``rooms``.

    Raises
    ------
    CertificateError
    """
    n, p = plant.n_x, plant.n_y
    for q, mode in enumerate(plant.modes):
        for side in SIDES:
            L = np.array(cert[f"L_{side}"][q])
            with ctx.workprec(PRECISION):
                whole = ball(np.zeros((n + p, n + p)))
                whole[:n, :n], whole[:n, n:] = ball(mode.A) - ball(L) @ ball(mode.C), ball(L)
                exact = exponential(whole, arb(float(plant.sample_period)))
            for index in np.ndindex(n, p):
                value, given = exact[index[0], n + index[1]], arb(float(getattr(t, f"L_{side}")[q][index]))
                where = f'L_{side}{list(index)} of mode "{mode.name}"'
                _note(left, "gain", abs(value) * float(np.finfo(t.real).eps) + 1e-30 - abs(value - given), where,
                      f"{where} is {float(given):.9g}, expected {float(value):.9g}: not the gain of the conditions, "
                      "held for a period. Design again.")


def settled(t, q: int, side: str, slack: Array) -> Array:
    """Errors that the step maps into themselves, a little more than the least."""
    M = getattr(t, f"M_{side}")[q].astype(float)
    gained = np.array([float(x.upper()) for x in slack]) * (1 + ROOM)
    return np.linalg.solve(np.eye(len(M)) - M, gained) * (1 + ROOM)


def sentences(plant, t, cert: dict) -> list[str]:
    """What is proved."""
    def time(samples: int) -> str:
        return f"{samples} samples ({samples * plant.sample_period:.4g} s)"

    width = "; ".join(f'"{m.name}" ' + ", ".join(f"{a + b:.4g}" for a, b in zip(*e))
                      for m, e in zip(plant.modes, cert["errors"]))
    return [
        "nothing is proved of the decision: out->mode may be wrong at any sample and for any time, so out->assured is "
        "0 at every sample; what was measured of it is in the report",
        "a mode's test fails only where that mode was not active all the time since its pair of bounds began, or a "
        f"fault acts; all rounding is included ({t.real}, with or without fused multiply-add)",
        "x_lo <= x <= x_hi at every sample while no fault acts, where out->mode has been the true mode since it was "
        "taken up; from a detection until then they are the declared range",
        f"no alarm is false while switches are at least {time(t.dwell)} apart",
        "widths of x_hi - x_lo that are approached while the mode is right and stays, by mode: " + width,
        "Theorem 12 on the gains of continuous time, exactly: P >= 1, and by mode gamma "
        + ", ".join(f"{x:.4g}" for x in cert["gamma"]) + " and beta " + ", ".join(f"{x:.4g}" for x in cert["beta"])
        + "; beta says nothing of how well modes are told apart (at least "
        f"{cert['target'] ** 2 * 2 * plant.n_y * plant.n_x:.4g} for any gains)",
    ]
