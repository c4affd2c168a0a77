"""A point observer that follows a mode estimator, in a view: the estimator's part, and the observer as inner C."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..observers.supervisor import Supervision
from . import mode_parts, point_parts
from .cprint import initialiser, literal
from .driven_parts import Copy
from .families import Member, Word, in_fields, state_layout
from .maps import MapView, Names, Table
from .mode_parts import ModeView
from .parts import Cut, Field, Operations, Parts, Size, vector_table
from .render import render

#: What the observer's calls keep, which are not in the inner C.
CALLS = ("phase", "run", "hold", "history", "latched", "spare")


@dataclass(frozen=True)
class Struct:
    """A struct of the inner C."""

    name: str
    fields: tuple[Field, ...]


@dataclass(frozen=True)
class InnerView:
    """What ``inner.c.jinja`` and the templates of the sets print; see ``DesignView`` for the names that both have."""

    prefix: str
    macro: str
    outer: str
    zero: str
    sizes: tuple[Size, ...]
    structs: tuple[Struct, ...]
    maps: tuple[MapView, ...]
    cuts: tuple[Cut, ...]
    whole_range: tuple[str, ...]
    sets: tuple[object, ...]
    skeleton: str = "inner.c.jinja"
    alone: tuple[str, ...] = ()


@dataclass(frozen=True)
class FollowerView(ModeView):
    """Beside the estimator's: the inner C, what of its state is kept, and what a start needs.

    ``copies`` and ``words`` are vectors and words that are lent to the observer, ``carried`` the vectors that it
    gives back; ``squares`` (a factor) and ``turn`` have an entry where the set begins with squares, or with half widths
    in other coordinates. ``reads`` are arguments of the observer's bounds beside its state, where they are of a mode.
    ``by_table`` starts a table from the declared range, ``again`` is when a table starts besides.
    """

    told: str
    forth: tuple[Table, ...]
    told_limit: Table
    range: tuple[Table, ...]
    middle: str
    grow: str
    floor: str
    squares: tuple[str, ...]
    turn: tuple[Table, ...]
    copies: tuple[Copy, ...]
    carried: tuple[Copy, ...]
    words: tuple[str, ...]
    reads: str
    by_table: tuple[str, ...]
    again: str


def parts(family: str, t, s, names: Names, signals: tuple, layout: str) -> Parts:
    """Decide what is the follower's own.

    Parameters
    ----------
    family : {"follower"}
    t : FollowerTables
    s : Supervision
    names : Names
    signals : tuple of tuple of Channel
        x, u, y and no parameters.
    layout : {"literal", "table", "loop"}
        Of the range checks and of the observer's maps; the boxes are loops over tables in each.

    Returns
    -------
    Parts
    """
    m, real, (x, u, *_) = names.macro, names.real_type, signals
    own = mode_parts.parts("mode", t, s, names, signals, layout)
    inner = inner_names(names)
    told = point_parts.parts(t.set, t.told, Supervision(), inner, signals, layout)
    rest = held(told, t, names, signals)
    numbers: list[Member] = [member for member in own.state.members if member[1] in ("box_lo", "box_hi")]
    numbers += rest.members
    numbers += [(real, f"told_{side}", f"[{m}_NX]", (f"{end} bounds of x, of the observer",))
                for side, end in (("lo", "lower"), ("hi", "upper"))]
    numbers += [member for member in own.state.members if member[1] == "alive"]
    clear = rest.clear + [f"s->told_{side}[{i}]" for side in ("lo", "hi") for i in range(len(x))]
    words: list[Word] = [("decided", "0U", "mode of the last answer"),
                         ("followed", f"{m}_MODES", f"mode in which the observer runs; {m}_MODES: none"),
                         ("measured", "0U", "1: the last sample had its measurement")]
    words += rest.initial
    boxes = next(n for name, n in own.lengths if name == "NSHAPE")
    state = state_layout(names, s, 1, numbers, 2 * boxes + len(clear), clear, words, extra=len(t.Phi))
    view = _view(own.sets[0], t, names, rest, inner_c(told, t, names, u))
    out = (Field(real, "x_hat", f"[{m}_NX]", ("estimate of x at this sample, in out->mode",)), *own.out_fields)
    return replace(own, noun="boxes and estimate", header="follower.h.jinja",
                   self_test="harness/test_follower.c.jinja", state=state, out_fields=out,
                   operations=own.operations + told.operations + _more(t), sets=(view,),
                   lengths=(*own.lengths, *(("NTOLD", rest.shape),) * bool(rest.shape)))


def inner_names(names: Names) -> Names:
    """Names of the inner C, which is given a mode that has been checked."""
    return replace(names, prefix=f"{names.prefix}_told", macro=f"{names.macro}_TOLD", checked=True)


def inner_c(told: Parts, t, names: Names, u: tuple) -> str:
    """Print the observer without its calls, for an estimator that drives it in the same file.

    Parameters
    ----------
    told : Parts
        Of the observer, by ``inner_names``.
    t : FollowerTables or GuidedPointTables
    names : Names
        Of the estimator.
    u : tuple of Channel
    """
    inner = inner_names(names)
    m = inner.macro
    sizes = [Size(name, f"{names.macro}_{name}", note) for name, note in (
        ("NX", "states"), *(("NU", "inputs") for _ in u[:1]), ("NY", "outputs"), ("MODES", "modes"))]
    sizes += [Size(f"BIT_{bit.macro}", bit.value, bit.text) for bit in told.bits if bit.macro == "TOGETHER"]
    members = [Field(*f) for f in told.state.members if f[1] not in CALLS]
    if all(f.name != "mode" for f in members):
        members.append(Field("uint32_t", "mode", "", ("mode of the last sample",)))
    given = [Field(*f) for f in in_fields(inner, len(u), 0) if f[1] != "spare"]
    answers = [f for f in told.out_fields if f.name in ("x_hat", "x_lo", "x_hi", "r", "r_bound")]
    structs = (Struct("state", whole(members, t.real)), Struct("in", whole(given, t.real)),
               Struct("out", tuple(answers)))
    d = InnerView(inner.prefix, m, names.prefix, literal(0.0, t.real), (*sizes, *told.sets[0].sizes), structs,
                  told.maps, told.cuts, told.whole_range, told.sets)
    return render(f"{t.set}.c.jinja", d=d).rstrip("\n")


@dataclass(frozen=True)
class Held:
    """What is kept of an observer in the state of the estimator that drives it.

    Parameters
    ----------
    vectors : tuple of Copy
        Numbers that are lent to it.
    words : tuple of str
        Words that are lent to it.
    members : list of Member
        Of the vectors, in the state.
    initial : list of Word
        Of the words.
    clear : list of str
        Numbers that ``clear`` sets to zero.
    shape : int
        Numbers of its set.
    """

    vectors: tuple[Copy, ...]
    words: tuple[str, ...]
    members: list[Member]
    initial: list[Word]
    clear: list[str]
    shape: int

    @property
    def carried(self) -> tuple[Copy, ...]:
        """Vectors that it gives back."""
        return tuple(v for v in self.vectors if v.name in ("x_hat", "shape"))


def held(told: Parts, t, names: Names, signals: tuple) -> Held:
    """Lay out what is kept of an observer that is driven; parameters as of ``inner_c``, all signals."""
    m, macro, (x, u, y, _) = names.macro, inner_names(names).macro, signals
    shape = next(count for name, count in told.lengths if name == "NSHAPE")  # none of a table
    sizes = {"x_hat": (f"{m}_NX", len(x)), "u": (f"{m}_NU", len(u)), "y": (f"{m}_NY", len(y)),
             "shape": (f"{m}_NTOLD", shape)}
    kept = [f for f in told.state.members if f[1] in sizes]
    origin = [f for f in told.state.members if f[0] == "uint32_t" and f[1] not in (*CALLS, "mode")]
    return Held(
        tuple(Copy(f[1], sizes[f[1]][0]) for f in kept), tuple(f[1] for f in origin),
        [(names.real_type, f"told_{f[1]}", f"[{sizes[f[1]][0]}]", tuple(line.replace(macro, m) for line in f[3]))
         for f in kept],
        [(f"told_{f[1]}", "0U" if t.by_table else f"{m}_MODES", " ".join(f[3]).replace(macro, m)) for f in origin],
        [f"s->told_{f[1]}[{i}]" for f in kept for i in range(sizes[f[1]][1])], shape)


def whole(members: list[Field], real: str) -> tuple[Field, ...]:
    """The members, a word to fill the struct where it needs one at its end."""
    odd = sum(f.type == "uint32_t" for f in members) % 2 and real == "float64"
    return (*members, *(Field("uint32_t", "spare", "", ("not read",)),) * bool(odd))


def _view(mode: ModeView, t, names: Names, rest: Held, inner: str) -> FollowerView:
    """Print the tables that join both."""
    m, real = names.macro, t.real
    S = Table("forth", f"[{m}_NX][{m}_NX]", (), tuple(f"{initialiser(row, real)}," for row in t.S_rounded))

    def vector(name, values):
        return vector_table(name, f"{m}_NX", values, real)

    turned = () if t.by_squares or not getattr(t.told.shape, "turned", False) else (Table(
        "turn", f"[{m}_NX][{m}_NX]", (), tuple(f"{initialiser(row, real)}," for row in t.told.shape.Z)),)
    ranges = tuple(vector(name, values) for name, values in (
        ("least", t.x_lo), ("most", t.x_hi), ("widest", t.widest)))
    size = (Size("NTOLD", f"{rest.shape}U", "numbers of the error set"),) * bool(rest.shape)
    return FollowerView(
        **vars(mode) | {"sizes": (*mode.sizes, *size)}, told=inner,
        forth=(S, vector("xi_room", t.xi_room)), told_limit=vector("told_limit", t.told.box),
        range=(*ranges, *turned), middle=literal(0.5, real), grow=literal(t.grow, real),
        floor=literal(t.floor, real), squares=(literal(t.square, real),) * t.by_squares, turn=turned,
        copies=rest.vectors, carried=rest.carried, words=rest.words,
        reads="&given, " * t.by_table, by_table=(f"{names.prefix}_told_set_box(&held, widest);",) * t.by_table,
        again=" || (!measured) || (s->measured == 0U)" * t.by_table)


def _more(t) -> Operations:
    """Count what joins both in the dearest sample, which starts the observer anew."""
    (n_modes, n, _, _), ages = t.sizes, t.ages + 1
    hulls = 2 + n_modes  # in a step, at a start, and in the answer
    return Operations(multiply=2 * n * n * (1 + hulls * ages) + 4 * n + n * n,
                      add=2 * n * n * (1 + hulls * ages) + 2 * n * (1 + hulls * ages) + 4 * ages * n + 5 * n + n * n,
                      compare=n * n * (1 + hulls * ages) + 2 * n * hulls * (ages + 1) + 3 * ages * n + 2 * n * n_modes
                      + 11 * n)
