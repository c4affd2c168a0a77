"""How much the framer errors can grow per sample: exact, rounding included.

With e_hi = x_hi - x and e_lo = x - x_lo both errors obey ``e+ = M e + b`` where b lies in [0, ``push``]:
offset, disturbance and noise at their least favourable, and the rounding margin once more, because the
computed framer may also round outward.

Where M is affine in theta the recursion is checked at the corners of the box of theta: ``M`` and ``push`` then have one
entry per mode and corner. Negative entries of M count with their magnitude. What a radius R max(-x_lo, x_hi) adds is
bounded with the declared range of x, to which the framers are cut.

With equal gains the width W = e_hi + e_lo obeys ``W+ = M W + (d_hi - d_lo)`` up to rounding, whatever happens to
the plant: the same recursion with its own push, and half the bound that adding both errors would give.

With a change of coordinates all this is about z = Z x; ``x_width`` leads from a box of z's widths to those of x.
"""

from __future__ import annotations

import numpy as np
from flint import fmpq

from .containment import Containment, dot, offset, sup
from .exact import Q, product, rational
from .variation import Affine

Array = np.ndarray


class ErrorModel:
    """Exact data of the error recursion of one table.

    Parameters
    ----------
    modes : sequence
        The plant's modes.
    t : FramerTables
    exact : Containment, optional
        Of the same tables, where the caller has it already.

    Attributes
    ----------
    M : dict
        side -> list over modes (and corners of theta) of rational (n_x, n_x), >= 0.
    push : dict
        side -> list as long, of rational (n_x,): largest b. With equal gains also "width".
    L : dict
        side -> list as long, of rational (n_x, n_y).
    mode : list of int
        Mode of each entry of these lists.
    theta2 : fmpq
        Largest squared norm of the stacked disturbance [b without noise; Dv v; Dv v+] over all modes.
    """

    def __init__(self, modes, t, exact: Containment | None = None):
        self.t = t
        exact = exact or Containment(modes, t)
        parts = {s: [exact.scheduled(q, s) for q in range(len(modes))] for s in ("hi", "lo")}
        corners = {s: [(q, M, L) for q, part in enumerate(parts[s])
                       for M, L in zip(part.M.corners(), part.L.corners())] for s in ("hi", "lo")}
        self.mode = [q for q, _, _ in corners["hi"]]
        self.M = {s: [abs(M) for _, M, _ in corners[s]] for s in ("hi", "lo")}
        self.L = {s: [L for _, _, L in corners[s]] for s in ("hi", "lo")}
        self.push = {"hi": [], "lo": []}
        noise2 = [sum((max(a, b) ** 2 for a, b in zip(sup(p["Dv"], p["v_lo"], p["v_hi"]),
                                                      sup(-p["Dv"], p["v_lo"], p["v_hi"]))), fmpq(0))
                  for p in exact.exact]
        tnl = bool(np.any(t.N_hi) or np.any(t.N_lo))
        self.theta2 = fmpq(0)
        for k, q in enumerate(self.mode):
            p = exact.exact[q]
            for side, sign in (("hi", 1), ("lo", -1)):
                slack, push = self._slack(exact, q, p, side, sign, self.L[side][k])
                self.push[side].append(push)
                theta2 = sum((s * s for s in slack), fmpq(0)) + noise2[q] + (max(noise2) if tnl else 0)
                self.theta2 = max(self.theta2, theta2)

        if t.signed:  # an entry that takes the opposite bound mixes both errors: what bounds both follows |M|
            self.push = dict.fromkeys(("hi", "lo"), [np.maximum(a, b) for a, b in zip(*self.push.values())])
        if t.vary is not None and t.vary.late:
            self._join(exact)
        elif t.shared:
            self.M["width"] = self.M["hi"]
            grown = [self._spread(exact, q) for q in range(len(modes))]
            self.push["width"] = [grown[q] + 2 * self._apart(exact, q, L) for q, L in zip(self.mode, self.L["hi"])]

    def _join(self, exact) -> None:
        """Let every step be the union with that of any other mode: its framer may miss the state by what they differ.

        The framer of mode p after a step of mode q: e+ = M_p e + (M_p + L_p C - T_p A_q) x + (G_p - T_p B_q) u
        - T_p Bw_q w + L_p Dv v + N_p Dv v+ + d_p + radius - T_p (unknowns of q), bounded over the ranges.
        """
        t = self.t
        for k, p in enumerate(self.mode):
            for side, sign in (("hi", 1), ("lo", -1)):
                s, L = exact.scheduled(p, side), self.L[side][k]
                signed = s.M.corners()[[j for j, m in enumerate(self.mode) if m == p].index(k)]
                T, _, _ = exact.leftover(p, side)
                apart = self._apart(exact, p, L)
                offset = [sign * Q(x) for x in getattr(t, "d_" + side)[p]]
                for r in exact.exact:
                    A = Affine(signed + product(L, r["C"]) - product(T, r["A"]), [-product(T, a) for a in r["A_theta"]],
                               r["box_lo"], r["box_hi"]).most()
                    B = Affine(s.G.middle - product(T, r["B"]), [-product(T, b) for b in r["B_theta"]], r["box_lo"],
                               r["box_hi"]).most() + s.G.radius
                    unknown = [product(abs(T), r[f"{name}_rad"]) + sum((abs(product(T, F)) for F in r[f"{name}_unc"]),
                                                                      abs(product(T, r[name])) * 0) for name in "AB"]
                    moved = sup(-sign * product(T, r["Bw"]), r["w_lo"], r["w_hi"])
                    noise = [sup(sign * product(gain, r["Dv"]), r["v_lo"], r["v_hi"]) for gain in (L, s.N)]
                    for i, demand in enumerate(exact.update(p, side)):
                        push = offset[i] + apart[i] + demand.rounding(offset[i], t.real) + demand.computed + moved[i]
                        push += dot(A[i], exact.box) + dot(B[i], exact.u_true) + noise[0][i] + noise[1][i]
                        push += dot(unknown[0][i], exact.box) + dot(unknown[1][i], exact.u_true)
                        push += dot(s.G.most()[i], exact.u_err) + dot(abs(L[i]) + abs(s.N[i]), exact.y_err)
                        self.push[side][k][i] = max(self.push[side][k][i], push)

    def _apart(self, exact, q: int, L: Array) -> Array:
        """Largest radius of each row at a corner of theta: R |x| + S |u| + |L| E over the declared ranges.

        |L(theta)| E is convex in theta, as |M(theta)| z is: together they are largest at a corner.
        """
        s = exact.scheduled(q, "hi")
        R, S = s.R.most(), s.S.most()
        return np.array([dot(R[i], exact.box) + dot(S[i], exact.u_max) + dot(s.E[i], abs(L[i]))
                         for i in range(len(exact.box))], dtype=object)

    def _spread(self, exact, q: int) -> Array:
        """Largest growth of the width in one sample without the radii: d_hi - d_lo, and the rounding of both sums."""
        out = [Q(a) - Q(b) for a, b in zip(self.t.d_hi[q], self.t.d_lo[q])]
        for side, sign in (("hi", 1), ("lo", -1)):
            offsets = getattr(self.t, "d_" + side)[q]
            for i, demand in enumerate(exact.update(q, side)):
                out[i] += demand.rounding(sign * Q(offsets[i]), self.t.real) + demand.computed
        return np.array(out, dtype=object)

    def _slack(self, exact, q, p, side, sign, L):
        """Return b without its noise terms, and b: elementwise maxima."""
        t = self.t
        N = exact.scheduled(q, side).N
        T, _, _ = exact.leftover(q, side)
        offset = [sign * Q(x) for x in getattr(t, "d_" + side)[q]]
        against = sup(-sign * product(T, p["Bw"]), p["w_lo"], p["w_hi"])
        along = sup(sign * product(T, p["Bw"]), p["w_lo"], p["w_hi"])
        fall = sup(-sign * product(L, p["Dv"]), p["v_lo"], p["v_hi"])
        rise = sup(sign * product(L, p["Dv"]), p["v_lo"], p["v_hi"])
        falls = [sup(-sign * product(N, s["Dv"]), s["v_lo"], s["v_hi"]) for s in exact.exact]
        apart = 2 * self._apart(exact, q, L)
        rises = [sup(sign * product(N, s["Dv"]), s["v_lo"], s["v_hi"]) for s in exact.exact]
        slack, push = [], []
        for i, x in enumerate(offset):
            margin = x - along[i] - fall[i] - max(r[i] for r in falls) + apart[i]
            # Least favourable magnitude: a noise that never vanishes can make the slack negative.
            never = abs(fall[i] + max(r[i] for r in falls))
            if t.vary is not None and t.vary.parameters:  # inside the box of theta it may be less than at the corners
                never = max(fall[i] + max(r[i] for r in falls), rise[i] + max(r[i] for r in rises))
            slack.append(max(x + against[i] + margin, never))
            push.append(x + against[i] + rise[i] + max(r[i] for r in rises) + margin)
        return slack, np.array(push, dtype=object)

    def x_width(self, boxes: dict) -> list:
        """Largest width of each x where the errors (or widths) of z are within ``boxes``, as of ``steady_box``.

        The offset b counts twice: it is no smaller than the rounding of its sum, which may act outward.
        """
        z = rational(np.array(boxes["width"]))
        b = [sum((2 * abs(Q(offset(self.t, "b", s)[0][i])) for s in ("hi", "lo")), Q(0)) for i in range(len(z))]
        return [dot(row, z) + extra for row, extra in zip(rational(self.t.change.X), b)]

    def box_violation(self, z: Array, side: str):
        """First (mode, state, excess) at which M_q z + push_q <= z or M_q z < z fails, or None.

        The first keeps the errors in the box, the second (implied by the first where push > 0) brings them
        there: without it a state that nothing drives and nothing damps would have the box 0.
        """
        for k, (M, push) in enumerate(zip(self.M[side], self.push[side])):
            stay = M @ z
            excess = stay + push - z
            for i in np.argsort([-float(e) for e in excess]):
                if excess[i] > 0 or stay[i] >= z[i]:
                    return self.mode[k], int(i), excess[i]
        return None

    def steady_box(self, side: str, rounds: int = 20000) -> Array | None:
        """Box that contains the error from some sample on, under arbitrary switching; None if none is found.

        Iterates z <- max_q(M_q z + push_q) in floating point, adds a thousandth, and lets exact arithmetic
        decide whether it is one.
        """
        M = np.array([[[float(x) for x in row] for row in m] for m in self.M[side]])
        b = np.array([[float(x) for x in row] for row in self.push[side]])
        z = b.max(axis=0)
        for _ in range(rounds):
            new = (M @ z + b).max(axis=0)
            if not np.all(np.isfinite(new)) or np.any(new > 1e12 * (1 + b.max())):
                return None
            done = np.all(new <= z * (1 + 1e-9))
            z = np.maximum(z, new)
            if done:
                break
        for extra in (1e-6, 1e-5, 1e-4, 1e-3, 1e-2):
            candidate = rational(z * (1 + extra) + extra * z.max() * 1e-6)
            if self.box_violation(candidate, side) is None:
                return np.array([float(x) for x in candidate])
        return None
