"""The run-time families as C: which struct members they have, what their maps read and write."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .cprint import REAL_BYTES, literal
from .maps import Linear, MapSpec, Names
from .varying import Varying

Array = np.ndarray
Member = tuple[str, str, str, tuple[str, ...]]  # C type, name, array size, comment
Word = tuple[str, str, str]  # name, value after init (or nothing: set elsewhere), comment


@dataclass(frozen=True)
class StateLayout:
    """Members of the state struct, its size in bytes, the statements that clear all but the framers."""

    members: tuple[Member, ...]
    size: int
    clear: tuple[str, ...]
    has_mode: bool


def specs(family: str, t, names: Names, x, y) -> tuple[MapSpec, MapSpec | Varying, MapSpec | Varying]:
    """State the three maps of a family: residual bounds, framers forward, framers blind.

    The last two are ``Varying`` where the tables have parameters or radii.

    Parameters
    ----------
    family : {"interval", "tnl"}
    t : FramerTables
    names : Names
    x, y : tuple of Channel

    Returns
    -------
    residual, forward, blind : MapSpec or Varying
    """
    p, m = names.prefix, names.macro
    states, outputs = (tuple(f"{v}[{c.index}] {c.name}" for c in cs) for v, cs in (("x", x), ("y", y)))
    now = {"selector": "in->mode", "index": "in->mode", "names": names}
    residual = MapSpec(
        f"{p}_residual", ("r_hi = pos(C) x_hi - neg(C) x_lo + D u + c_hi - y",
                          "r_lo = pos(C) x_lo - neg(C) x_hi + D u + c_lo - y"),
        (f"const {p}_in *in", f"{p}_out *out"), target_lo="out->r_lo", target_hi="out->r_hi", rows=outputs,
        common=_inputs(names, ("D", t.D, t.D, "in->u", "NU")), shared=True, offset=Linear("c", t.c_lo, t.c_hi),
        state=Linear("C", t.C, t.C, "out->x", f"{m}_NX"), by_sign=True, minus="in->y", tail=(),
        row_count=f"{m}_NY", **now)
    if family == "interval":
        own = {"parameters": (f"{p}_state *s", f"const {p}_in *in", f"const {p}_out *out"), **now}
        read, target, u, last_y = "out->x", "s->x", "in->u", "in->y"
        blind_own = own
        if t.change is not None:
            read = target = "s->z"
    else:
        # A state overwritten by an upset of the memory must not read a table out of bounds.
        index = f"(s->mode < {m}_MODES) ? s->mode : 0U"
        then = {"selector": "s->mode", "index": index, "names": names}
        own = {"parameters": (f"const {p}_state *s", f"const {p}_in *in", f"{p}_out *out"), **then}
        read, target, u, last_y = "s->x", "out->x", "s->u", "s->y"
        blind_own = own | {"parameters": (f"const {p}_state *s", f"{p}_out *out")}
        if t.change is not None:  # of bounds that are held for one mode: they move where they are
            read = target = "s->z"
            own |= {"parameters": (f"{p}_state *s", f"const {p}_in *in")}
            blind_own |= {"parameters": (f"{p}_state *s",)}
    cut, blind_tail = ((f"{p}_cut({target}_lo, {target}_hi);",),) * 2
    to = {"target_lo": f"{target}_lo", "target_hi": f"{target}_hi", "rows": states, "row_count": f"{m}_NX",
          "minus": ""}
    blind_read, blind_to = read, to
    if t.change is not None:  # blind moves x, forward z
        blind_read = "out->x" if family == "interval" else "s->x"
        blind_to = to | {"target_lo": "s->x_lo", "target_hi": "s->x_hi"}
        to = to | {"rows": z_rows(t)}
        cut, blind_tail = ((f"{p}_cut_z(s->z_lo, s->z_hi);", f"{p}_to_x(s);"),
                           (f"{p}_cut(s->x_lo, s->x_hi);", f"{p}_to_z(s);"))
    gains = [("G", t.G_lo, t.G_hi, u, "NU"), ("L", t.L_lo, t.L_hi, last_y, "NY")]
    if family == "tnl":
        gains.append(("N", t.N_lo, t.N_hi, "in->y", "NY"))
    forward = MapSpec(f"{p}_forward", _forward_equation(family, t.clamp), common=_inputs(names, *gains),
                      shared=t.shared, offset=Linear("d", t.d_lo, t.d_hi),
                      state=Linear("M", t.M_lo, t.M_hi, read, f"{m}_NX"), by_sign=False,
                      tail=cut if t.clamp else (), **own, **to)
    blind = MapSpec(f"{p}_blind", ("x_hi+ = pos(A) x_hi - neg(A) x_lo + B u + a_hi",
                                   "x_lo+ = pos(A) x_lo - neg(A) x_hi + B u + a_lo, both cut to the range of x"),
                    common=_inputs(names, ("B", t.B, t.B, u, "NU")), shared=True,
                    offset=Linear("a", t.a_lo, t.a_hi), state=Linear("A", t.A, t.A, blind_read, f"{m}_NX"),
                    by_sign=True, tail=blind_tail, **blind_own, **blind_to)
    return (residual, forward, blind) if t.vary is None else (residual, *_varying(family, t, forward, blind, u))


def change_specs(t, names: Names, x) -> tuple[MapSpec, ...]:
    """State the maps from the bounds of z = Z x to those of x, and back; none without a change of coordinates."""
    if t.change is None:
        return ()
    c, p, m, modes = t.change, names.prefix, names.macro, len(names.modes)

    def spec(to: str, of: str, matrix: str, offset: str, rows: tuple[str, ...], tail: str) -> MapSpec:
        lo, hi, values = (np.broadcast_to(getattr(c, k), (modes, *getattr(c, k).shape))
                          for k in (f"{offset}_lo", f"{offset}_hi", matrix))
        heading = (f"{to}_hi = pos({matrix}) {of}_hi - neg({matrix}) {of}_lo + {offset}_hi",
                   f"{to}_lo = pos({matrix}) {of}_lo - neg({matrix}) {of}_hi + {offset}_lo, both cut to the range of "
                   f"{to}")
        return MapSpec(f"{p}_to_{to}", heading, (f"{p}_state *s",), "0U", "0U", f"s->{to}_lo", f"s->{to}_hi", rows, (),
                       True, Linear(offset, lo, hi), Linear(matrix, values, values, f"s->{of}", f"{m}_NX"), True, "",
                       (tail,), f"{m}_NX", names)

    return (spec("x", "z", "X", "b", tuple(f"x[{i.index}] {i.name}" for i in x), f"{p}_cut(s->x_lo, s->x_hi);"),
            spec("z", "x", "Z", "e", z_rows(t), f"{p}_cut_z(s->z_lo, s->z_hi);"))


def z_rows(t) -> tuple[str, ...]:
    """Name the entries of z."""
    return tuple(f"z[{i}]" for i in range(len(t.box)))


def late_specs(forward: Varying, blind: Varying, names: Names) -> tuple[Varying, Varying]:
    """The same maps for the mode that is told now, into another output struct."""
    p = names.prefix
    out = []
    for v in (forward, blind):
        parameters = (f"const {p}_state *s", f"const {p}_in *in", f"{p}_out *out")
        heading = (*v.spec.equation, "of the mode that is told now, which may have been that of the last step")
        out.append(replace(v, spec=replace(v.spec, name=f"{v.spec.name}_late", equation=heading, parameters=parameters,
                                           selector="in->mode", index="in->mode")))
    return out[0], out[1]


def _varying(family: str, t, forward: MapSpec, blind: MapSpec, inputs: str) -> tuple[Varying, Varying]:
    """Add parameters and radii to the maps that move the framers."""
    vary, half = t.vary, literal(0.5, t.real)
    kept = "in->theta" if family == "interval" else "s->theta"
    theta = tuple(f"{half} * (s->theta[{j}] + in->theta[{j}])" if vary.midpoint else f"{kept}[{j}]"
                  for j in range(vary.parameters))
    wide = "R max(-x_lo, x_hi) + S |u|"
    noise = " + |L| E" if np.any(vary.E) else ""
    of = "(theta)" if vary.parameters else ""
    terms = f"G{of} u + L{of} y + " + ("N y+ + " if family == "tnl" else "")
    more = " M takes the opposite bound of x where it is negative." if t.signed else ""
    x = "x" if t.change is None else "z"
    more = more.replace("bound of x", f"bound of {x}")
    heading = (f"{x}_hi+ = M{of} {x}_hi + {terms}d_hi + radius,  radius = {wide}{noise}",
               f"{x}_lo+ = M{of} {x}_lo + {terms}d_lo - radius, both cut to the range of {x}.{more}")
    middle = ("theta: mean of both ends of the step",) if vary.midpoint else ()
    blind = replace(blind, equation=("x_hi+ = pos(A) x_hi - neg(A) x_lo + B u + a_hi + radius,  radius = "
                                     "R max(-x_lo, x_hi) + S |u|",
                                     "x_lo+ = pos(A) x_lo - neg(A) x_hi + B u + a_lo - radius, both cut to the range "
                                     "of x, for every theta within its bounds"))
    middle += ("parameters and products; g: least where a parameter moved at its rate, scales a part of R and S",
               ) * bool(vary.paced)
    forward = replace(forward, equation=(*heading, *middle))
    near = blind.state.operand
    signs = {"x_sign": _signs(t.x_lo, t.x_hi), "u_sign": _signs(t.u_lo, t.u_hi)}
    slopes = {"M": vary.M, "G": vary.G, "L": vary.L} | ({"R": vary.R_pace, "S": vary.S_pace} if vary.paced else {})
    paced = tuple((f"in->theta[{j}] - s->theta[{j}]", float(a), float(b))
                  for j, a, b in zip(vary.paced, vary.pace, vary.top)) if vary.paced else ()
    return (Varying(forward, theta, slopes, t.flipped, vary.R, vary.S, vary.E, inputs, near, _gain_signs(t), **signs,
                    products=vary.products, paced=paced),
            Varying(blind, (), {}, None, vary.Ra, vary.Sa, np.zeros_like(vary.E[:, :, :0]), inputs,
                    near, np.zeros_like(vary.E[:, :, :0]), **signs))


def _signs(lo: Array, hi: Array) -> Array:
    """1 where a range has no negative number, -1 where it has no positive one, else 0."""
    return np.where(lo >= 0, 1, np.where(hi <= 0, -1, 0))


def _gain_signs(t) -> Array:
    """Signs of L(theta) over the bounds of theta, 0 where it has both, 2 where L is zero; (N, n_x, n_y).

    The computed L may be beyond zero by its rounding: the offsets hold that as well. ``room`` is for float64 here.
    """
    lo, hi = (b.astype(float)[:, :, None, None] for b in (t.vary.theta_lo, t.vary.theta_hi))
    slopes, base = t.vary.L.astype(float), t.L_hi.astype(float)
    ends = np.minimum(lo * slopes, hi * slopes).sum(axis=1), np.maximum(lo * slopes, hi * slopes).sum(axis=1)
    room = 1e-12 * (np.abs(base) + (np.maximum(np.abs(lo), np.abs(hi)) * np.abs(slopes)).sum(axis=1))
    zero = (base == 0) & np.all(slopes == 0, axis=1)
    return np.where(zero, 2, np.where(base + ends[0] > room, 1, np.where(base + ends[1] < -room, -1, 0)))


def _inputs(names: Names, *parts) -> tuple[Linear, ...]:
    """Make the common terms; those of the input only if there is one."""
    return tuple(Linear(name, lo, hi, operand, f"{names.macro}_{count}") for name, lo, hi, operand, count in parts
                 if lo.shape[2])


def _forward_equation(family: str, clamp: bool) -> tuple[str, ...]:
    terms = "G u + L y + " + ("N y+ + " if family == "tnl" else "")
    cut = (", both cut to the range of x",) if clamp else ("",)
    return (f"x_hi+ = M x_hi + {terms}d_hi", f"x_lo+ = M x_lo + {terms}d_lo{cut[0]}")


def state_fields(family: str, names: Names, s, n_bits: int, sizes: tuple[int, int, int, int],
                 z: tuple[str, ...] = ()) -> StateLayout:
    """Lay out the state: numbers first, then 32-bit words, so that no compiler pads it.

    ``s`` is the Supervision, ``sizes`` are n_x, n_u, n_y and the number of measured parameters;
    ``z`` says what z is, where there is a change of coordinates.
    """
    m, real, (n_x, n_u, n_y, n_theta) = names.macro, names.real_type, sizes
    numbers: list[Member] = [
        (real, "x_lo", f"[{m}_NX]", ("lower bounds of x; unit and order of x",)),
        (real, "x_hi", f"[{m}_NX]", ("upper bounds of x",))]
    if z:
        numbers += [(real, "z_lo", f"[{m}_NX]", ("lower bounds of z, from which those of x follow:", *z)),
                    (real, "z_hi", f"[{m}_NX]", ("upper bounds of z",))]
    if family == "tnl":
        numbers += [(real, "u", f"[{m}_NU]", ("inputs of the last sample",))] * bool(n_u)
        numbers.append((real, "y", f"[{m}_NY]", ("measurements of the last measured sample",)))
        numbers += [(real, "theta", f"[{m}_NTHETA]", ("parameters of the last measured sample",))] * bool(n_theta)
    vectors = (("u", n_u), ("y", n_y), ("theta", n_theta)) if family == "tnl" else ()
    kept = [f"s->{v}[{i}]" for v, n in vectors for i in range(n)]
    words: list[Word] = []
    if _keeps_mode(family, names, s):
        words.append(mode_word(m))
    if family == "tnl":
        words.append(("phase", f"{m}_FRESH", "0: x_lo, x_hi are this sample's; 1: last sample's, without y; 2: with y"))
    return state_layout(names, s, n_bits, numbers, (4 if z else 2) * n_x + len(kept), kept, words)


def _keeps_mode(family: str, names: Names, s) -> bool:
    """Whether the state holds the mode of the last sample."""
    return s.monitors_dwell or (family == "tnl" and len(names.modes) > 1)


def mode_word(m: str) -> Word:
    """The mode of the last sample."""
    return "mode", f"{m}_MODES", f"mode of the last sample; {m}_MODES: none yet"


def state_layout(names: Names, s, n_bits: int, numbers: list[Member], reals: int, kept: list[str],
                 words: list[Word], extra: int = 0) -> StateLayout:
    """Lay out a state of a family's own numbers and words, and after them the supervisor's words.

    Parameters
    ----------
    names : Names
    s : Supervision
    n_bits : int
        Alarm bits.
    numbers : list of Member
        Vectors of numbers, ``reals`` in total.
    reals : int
    kept : list of str
        Numbers that ``clear`` sets to zero.
    words : list of Word
        Words of the family.
    extra : int
        Words among ``numbers``, at their end.

    Returns
    -------
    StateLayout
    """
    m, words = names.macro, list(words)
    if s.monitors_dwell:
        words += [("bucket", "0U", f"fill of the dwell-time monitor, 0 to {s.dwell_limit}"),
                  ("too_fast", "0U", "1 from an overflow of the bucket until it has run empty")]
    words.append(("run", "0U", f"samples outside bounds in a row, below {max(s.recover, 1)}"))
    if s.counts_hold:
        words.append(("hold", "0U", f"samples within bounds still to come before assured may return, 0 to {s.hold}"))
    members = numbers + [("uint32_t", name, "", (note,)) for name, _, note in words]
    clear = [f"{place} = {literal(0.0, names.real)};" for place in kept]
    clear += [f"s->{name} = {value};" for name, value, _ in words if value]
    count = len(words) + 1 + extra
    if s.debounce[1] > 1:
        members.append(("uint32_t", "history", f"[{m}_BITS]",
                        (f"per alarm bit its last {s.debounce[1]} samples, the newest in bit 0",)))
        clear += [f"s->history[{i}] = 0U;" for i in range(n_bits)]
        count += n_bits
    members.append(("uint32_t", "latched", "", ("alarm bits as in out->latched",)))
    clear.append("s->latched = 0U;")
    if names.real == "float64" and count % 2:
        members.append(("uint32_t", "spare", "", ("always 0: fills the struct to a multiple of 8 bytes",)))
        clear.append("s->spare = 0U;")
        count += 1
    size = 4 * count + REAL_BYTES[names.real] * reals
    return StateLayout(tuple(members), size, tuple(clear), any(name == "mode" for name, _, _ in words))


def in_fields(names: Names, n_u: int, n_theta: int, told: bool = True) -> tuple[Member, ...]:
    """Members of the input struct; ``told``: the mode is one."""
    m, real = names.macro, names.real_type
    inputs = ((real, "u", f"[{m}_NU]", ("inputs that act from this sample to the next",)),)
    spare = (("uint32_t", "spare", "", ("not read: fills the struct to a multiple of 8 bytes",)),)
    parameters = ((real, "theta", f"[{m}_NTHETA]", ("parameters as measured at this sample",)),) * bool(n_theta)
    numbers = (*(inputs if n_u else ()), (real, "y", f"[{m}_NY]", ("measurements of this sample",)), *parameters)
    if not told:
        return numbers
    return (*numbers,
            ("uint32_t", "mode", "", ("mode that acts from this sample to the next",)),
            *(spare if names.real == "float64" else ()))


def out_fields(names: Names) -> tuple[Member, ...]:
    """Members of the output struct."""
    m, real = names.macro, names.real_type
    word = "uint32_t"
    return ((real, "x_lo", f"[{m}_NX]", ("lower bounds of x at this sample",)),
            (real, "x_hi", f"[{m}_NX]", ("upper bounds of x at this sample",)),
            (real, "r_lo", f"[{m}_NY]", ("lower bound of y minus y; above 0 proves a fault; 0 after predict",)),
            (real, "r_hi", f"[{m}_NY]", ("upper bound of y minus y; below 0 proves a fault; 0 after predict",)),
            (word, "raw", "", (f"{m}_BIT_ of what is outside its bounds at this sample; 0 after predict",)),
            (word, "alarm", "", ("the same after the debounce; 0 after predict",)),
            (word, "latched", "", ("alarm bits as kept; act on these",)),
            (word, "assured", "", ("1: the bounds and alarms of this sample are guaranteed; 0: they are not",)))
