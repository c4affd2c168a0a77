"""By how much each condition of a certificate holds, in exact arithmetic on the constants of the C.

A margin is what is left of the inequality, in its own units: 0 is met with equality, below 0 is not met. It is
rounded down to a float, so that what is printed holds too. ``certify`` decides; this says how closely.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from flint import fmpq

from ..certify.claims import image_of
from ..certify.containment import Containment, offset
from ..certify.criteria import check_linf, check_width, lyapunov_block
from ..certify.error_model import ErrorModel
from ..certify.exact import Q, down, rational
from ..certify.exact import exact_pivots as _pivots

SIDES = ("hi", "lo")


@dataclass(frozen=True)
class Margin:
    """The tightest of a set of inequalities: what is compared, what is left of it, where."""

    what: str
    left: fmpq
    where: str = ""
    strict: bool = False

    @property
    def holds(self) -> bool:
        """Whether the inequality is met."""
        return self.left > 0 if self.strict else self.left >= 0

    def to_dict(self) -> dict:
        """Return plain data; the margin as a float that is not above it."""
        return {"what": self.what, "margin": down(self.left), "expected": "> 0" if self.strict else ">= 0",
                "where": self.where}


def tightest(what: str, cases, strict: bool = False) -> Margin:
    """Return the smallest of (left, where) pairs.

    Parameters
    ----------
    what : str
    cases : iterable of (fmpq, str)
    strict : bool
        Equality is not enough.

    Returns
    -------
    Margin
    """
    return Margin(what, *min(cases, key=lambda case: case[0]), strict)


def nonnegative(modes, t) -> list[Margin]:
    """The entries of M over the box of the parameters; those that take the opposite bound count as -M."""
    exact, cases = Containment(modes, t), []
    for side in SIDES:
        for q, mode in enumerate(modes):
            M = exact.scheduled(q, side).M
            least, most = M.least(), M.largest()
            cases += [(-most[index] if flipped else least[index],
                       f'M_{side}{list(map(int, index))}, mode "{mode.name}"')
                      for index, flipped in np.ndenumerate(t.flipped[q])]
    return [tightest("smallest entry of M, with the sign for which its bound is taken" if t.signed
                     else "smallest entry of M", cases)]


def contained(modes, t) -> list[Margin]:
    """Offsets: what each has beyond its demand, rounding of its own sum included."""
    cases: dict[str, list] = {}
    for name, q, side, demands in Containment(modes, t).offsets():
        for i, demand in enumerate(demands):
            value = Q(offset(t, name, side)[q][i]) * (1 if side == "hi" else -1)
            cases.setdefault(name, []).append((-demand.shortfall(value, t.real),
                                               f'{name}_{side}[{i}], mode "{modes[q].name}"'))
    return [tightest(f"offset {name} beyond its demand", found) for name, found in cases.items()]


def bounded(modes, t) -> list[Margin]:
    """The state box: beyond the declared ranges, and beyond what any step can make of it."""
    reach = np.max(np.abs([t.x_lo, t.x_hi, t.x0_lo, t.x0_hi]), axis=0)
    out = [tightest("state box beyond the declared ranges", [(Q(b) - Q(r), f"state {i}")
                                                             for i, (b, r) in enumerate(zip(t.box, reach))])]
    if t.change is not None:
        out.append(tightest("range of z beyond what Z makes of the range of x",
                            [(left, f"z[{i % len(t.box)}]") for i, left in enumerate(image_of(t))]))
    if t.clamp:
        return out
    exact = Containment(modes, t)
    cases = [(exact.box[i] - demand.magnitude(Q(getattr(t, "d_" + side)[q][i]), t.real),
              f'state {i}, {side}, mode "{mode.name}"') for q, mode in enumerate(modes) for side in SIDES
             for i, demand in enumerate(exact.update(q, side))]
    return [*out, tightest("state box beyond one step from within it", cases)]


def linf(modes, t, cert: dict) -> list[Margin]:
    """The Lyapunov inequality's smallest pivot, the jump factor, the dwell time, the level."""
    model, names = ErrorModel(modes, t), [m.name for m in modes]
    lam, mu, rho = Q(cert["lam"]), Q(cert["mu"]), Q(cert["rho"])
    pivots, jumps, norms = [], [], []
    for side in SIDES:
        P = rational(np.array(cert["P_" + side]))
        norms += [(x - 1, f'{side}, mode "{names[q]}", state {i}') for (q, i), x in np.ndenumerate(P)]
        for k, q in enumerate(model.mode):
            N = rational(getattr(t, f"N_{side}")[q])
            block = lyapunov_block(model.M[side][k], model.L[side][k], N, P[q], lam, mu)
            pivots += [(pivot, f'{side}, {_corner(model, t, names, k)}, row {i}')
                       for i, pivot in enumerate(_pivots(block))]
        for q, name in enumerate(names):
            jumps += [(rho * P[r][i] - P[q][i], f'{side}, from "{other}" to "{name}", state {i}')
                      for r, other in enumerate(names) for i in range(P.shape[1])]
    out = [tightest("smallest pivot of the Lyapunov matrix", pivots, strict=True),
           tightest("P - I on the diagonal", norms), tightest("rho P_l - P_q at a jump", jumps)]
    if rho > 1:
        left = 1 - (1 - lam) ** cert["dwell_add"] * rho ** cert["dwell_drain"]
        out.append(Margin("1 - (1 - lambda)^add rho^drain", left, strict=True))
    if not all(margin.holds for margin in out):  # the level rests on them
        return out
    proved = check_linf(model, t, cert, names)["error_bound2"]
    return [*out, Margin("square of the claimed level beyond the proved one", Q(cert["level"]) ** 2 - proved)]


def width(modes, t, cert: dict) -> list[Margin]:
    """The copositive function's decay, and the level."""
    model, names = ErrorModel(modes, t), [m.name for m in modes]
    p, a = rational(np.array(cert["p"])), Q(cert["a"])
    cases = [((1 - a) * p[j] - x, f"{side}, {_corner(model, t, names, k)}, state {j}")
             for side in (("width",) if "width" in model.push else SIDES) for k, M in enumerate(model.M[side])
             for j, x in enumerate(p @ M)]
    proved = check_width(model, cert, names)["width_bound"]
    return [tightest("(1 - a) p' - p' M", cases), Margin("claimed level beyond the proved one",
                                                         Q(cert["level"]) - proved)]


def box(modes, t, cert: dict) -> list[Margin]:
    """The ultimate box: it is not left, and it is reached."""
    model, stay, reach, names = ErrorModel(modes, t), [], [], [m.name for m in modes]
    for side, values in cert["steady_box"].items():
        z = rational(np.array(values))
        for k, (M, push) in enumerate(zip(model.M[side], model.push[side])):
            for i, x in enumerate(M @ z):
                where = f"{side}, {_corner(model, t, names, k)}, state {i}"
                stay.append((z[i] - x - push[i], where))
                reach.append((z[i] - x, where))
    if t.change is not None:
        wide = [(Q(a) - b, f"state {i}") for i, (a, b) in enumerate(zip(cert["x_width"],
                                                                          model.x_width(cert["steady_box"])))]
        return [tightest("z - (M z + push)", stay), tightest("z - M z", reach, strict=True),
                tightest("widths of x beyond what the box of z leads to", wide)]
    return [tightest("z - (M z + push)", stay), tightest("z - M z", reach, strict=True)]


def _corner(model: ErrorModel, t, names: list[str], k: int) -> str:
    """The mode of an entry of the error model and, where it has several, the corner of the parameters' box."""
    q = model.mode[k]
    corners = [j for j, mode in enumerate(model.mode) if mode == q]
    return f'mode "{names[q]}"' + (f", corner {corners.index(k)} of theta" if len(corners) > 1 else "")


def parameters(modes, t) -> list[Margin]:
    """What the check of the parameters accepts, beyond what the plant file declares, error of measurement included."""
    cases = [(sign * (Q(table) - Q(declared)), f'parameter {j}, {side}, mode "{mode.name}"')
             for q, mode in enumerate(modes) for side, sign in (("lo", -1), ("hi", 1))
             for j, (table, declared) in enumerate(zip(getattr(t.vary, f"theta_{side}")[q],
                                                       getattr(mode, f"theta_{side}")))]
    return [tightest("accepted theta beyond the declared bounds", cases)]


def ranges(limits: dict, t) -> list[Margin]:
    """The boxes to start from, beyond those that the plant file declares."""
    return [tightest(f"{name} box beyond the declared one", [
        (sign * (Q(table[i]) - Q(declared[i])), f"state {i}, {side}") for i in range(len(t.box))
        for side, sign, table, declared in (("lo", -1, getattr(t, name + "_lo"), lo),
                                            ("hi", 1, getattr(t, name + "_hi"), hi))])
        for name, (lo, hi) in limits.items()]


def monitor(s, cert: dict) -> list[Margin]:
    """The bucket against the certificate's dwell time and chatter bound."""
    if cert["kind"] != "linf" or cert["rho"] <= 1 or cert["dwell_add"] <= cert["dwell_drain"]:
        return []
    limit = Fraction(cert["chatter"]) * s.dwell_add - s.dwell_limit
    return [Margin("dwell time watched beyond the certificate's, as add drain' - add' drain",
                   fmpq(s.dwell_add * cert["dwell_drain"] - cert["dwell_add"] * s.dwell_drain)),
            Margin("bucket's limit below chatter bound times add", fmpq(limit.numerator, limit.denominator))]
