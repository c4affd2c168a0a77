"""What the command line prints: tables for people."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from .errors import DesignError
from .plant.model import Plant
from .report.words import count

out = Console(highlight=False, soft_wrap=True)
if not out.is_terminal:  # into a file or a pipe: do not fold the tables to 80 columns
    out.width = 132


def table(title: str, *columns: str) -> Table:
    """Start a table."""
    t = Table(title=title, title_justify="left", show_edge=False, pad_edge=False)
    for name in columns:
        t.add_column(name, overflow="fold")
    return t


def number(x: float | None) -> str:
    """Print a figure, or a dash where there is none."""
    return "-" if x is None or not np.isfinite(x) else f"{x:.4g}"


def plant(p: Plant) -> None:
    """Print a plant as understood, its properties, and which methods apply."""
    from .synthesis import METHODS

    out.print(f"{p.name}: {p.title}" + (f"\n{p.source}" if p.source else ""))
    out.print(f"{p.kind}, sample period {p.sample_period:g} s; "
              + ", ".join((*(count(n, noun) for n, noun in (
                  (p.n_x, "state"), (p.n_u, "input"), (p.n_y, "output"), (p.n_w, "disturbance"), (p.n_v, "noise"),
                  (p.n_f, "fault"))), _count(p))))
    signals = table("\nsignals", "vector", "name", "unit", "from", "to")
    for vector in ("x", "u", "y", "w", "v", "f", "theta"):
        for s in getattr(p, vector):
            signals.add_row(vector, s.name, s.unit, number(s.lo), number(s.hi))
    out.print(signals)
    if p.theta:
        out.print(_parameters(p))
    if p.polytope is None:
        _modes(p)
    else:
        _polytope(p)
    rows = table("\nmethods", "method", "applies")
    for names, answer in _grouped({name: _applies(p, name, entry) for name, entry in METHODS.items()}):
        rows.add_row(names, escape(answer))  # "[[mode]]" is no markup
    out.print(rows)


def _grouped(answers: dict[str, str]) -> list[tuple[str, str]]:
    """A row per method, then one for all that are refused for the reason of more than three."""
    alike: dict[str, list[str]] = {}
    for name, answer in answers.items():
        alike.setdefault(answer, []).append(name)
    many = {answer: names for answer, names in alike.items() if len(names) > 3 and answer != "yes"}
    return [*((name, answer) for name, answer in answers.items() if answer not in many),
            *((", ".join(names), answer) for answer, names in many.items())]


def _modes(p: Plant) -> None:
    """Print the modes and how the plant switches between them."""
    from .plant.detector import fault_parameters
    from .plant.properties import properties
    from .show_modes import telling

    if faults := fault_parameters(p):
        out.print(f"\ndetector: observers of this plant bear {', '.join(faults)}; where these stand for faults, one of "
                  "codegen.plant.detector.detector(plant), with their bounds at zero, sees them")
    if p.kind == "continuous":
        out.print("\nsampling: " + p.options.get("sampling", "exponential") + "; " + between(p))
    title = "\nmodes" + (", worst corner of theta" if p.theta else "")
    modes = table(title, "mode", "spectral radius" if p.kind == "discrete" else "spectral abscissa", "stable",
                  "observable", "detectable", "cooperative")
    for m in properties(p):
        modes.add_row(m.name, number(m.radius), *("yes" if x else "no" for x in
                                                  (m.stable, m.observable, m.detectable, m.cooperative)))
    out.print(modes)
    s = p.switching
    told = "known at run time" + (", perhaps one sample late" if s.late else "")
    out.print("\nswitching: " + (told if s.known else "unknown") + (
        ", arbitrary" if not s.average_dwell else f", at least {s.average_dwell:g} s between switches"
        if s.chatter == 1 else f", average dwell time {s.average_dwell:g} s, chatter bound {s.chatter:g}"))
    telling(p, out)


def _polytope(p: Plant) -> None:
    """Print what the vertices of a polytopic plant are, one by one, and what is proved for all that lies between."""
    from .plant.properties import hull_admissible, vertex_properties

    if p.polytope.premises:
        rows = table("\npremises (the weights of the vertices are products of theirs)", "name", "term", "from", "to")
        for z in p.polytope.premises:
            rows.add_row(z.name, str(z.term.evalf(6)), number(z.lo), number(z.hi))
        out.print(rows)
        out.print("\nmodel: exact while every term is within its bounds")
    elif p.polytope.equations and len(p.polytope.vertices) > 1:
        out.print("\nmodel: linearised at points; nothing bounds its error between them")
    rows = table("\nvertices, each alone", "vertex", "finite eigenvalues", "regular", "impulse-free", "stable",
                 "R-observable", "C-observable", "I-observable", "detectable")
    for v in vertex_properties(p):
        sizes = np.abs(v.finite) if p.kind == "discrete" else v.finite.real
        span = f"{len(sizes)}, {'largest' if p.kind == 'discrete' else 'abscissa'} {number(sizes.max(initial=-np.inf))}"
        rows.add_row(v.name, span, *({True: "yes", False: "no", None: "too close to tell"}[x] for x in (
            v.regular, v.impulse_free, v.stable, v.r_observable, v.c_observable, v.i_observable, v.detectable)))
    out.print(rows)
    if p.polytope.known:
        out.print("\nin no vertex, but known at run time and added there: "
                  + ", ".join(f"{k.term.evalf(6)} in row {k.row + 1}" for k in p.polytope.known))
    out.print("\nbetween the vertices: " + {
        True: "admissible for every weight, however it moves (one Lyapunov matrix for all vertices, checked exactly)",
        False: "not shown to be admissible (no common Lyapunov matrix found); the table above says nothing of it",
    }[hull_admissible(p)])


def _count(p: Plant) -> str:
    """How many modes or vertices."""
    return count(p.n_modes, "mode") if p.polytope is None else f"{len(p.polytope.vertices)} vertices"


def _parameters(p: Plant) -> Table:
    """List what is known of each parameter: bounds per mode where they differ, rate, measurement."""
    rows = table("\nparameters", "theta", "bounds", "rate per s", "measured", "error")
    for j, s in enumerate(p.theta):
        boxes = [p.theta_box(mode) for mode in p.modes] or [p.limits("theta")]
        limits = [(lo[j], hi[j]) for lo, hi in boxes]
        spans = [f"{number(lo)} to {number(hi)}" for lo, hi in limits]
        rows.add_row(s.name, spans[0] if len(set(limits)) == 1 else
                     "; ".join(f"{m.name}: {span}" for m, span in zip(p.modes, spans)),
                     number(s.rate) if np.isfinite(s.rate) else "any", "yes" if s.measured else "no",
                     number(s.error) if s.measured else "-")
    return rows


def between(p: Plant) -> str:
    """Say what a continuous plant may do between samples."""
    inputs = [f"{s.name} moves by at most {number(s.rate)} {s.unit}/s" if s.rate else f"{s.name} is held" for s in p.u]
    switches = [f"the mode changes {'at samples only' if p.switching.known else 'at any instant'}"] * (p.n_modes > 1)
    moving = [what for what, some in (("disturbances", p.w), ("parameters", p.theta)) if some]
    return "; ".join([*inputs, *switches, *([f"{' and '.join(moving)} move as they like"] if moving else [])])


def _applies(p: Plant, name: str, entry) -> str:
    from .synthesis.problem import Problem
    from .synthesis.structure import obstruction

    reason = entry.module.inapplicable(p)
    if reason is not None:
        return reason
    try:
        if entry.sets or entry.family == "filter":
            _ = p.enclosed  # a period may be too long for the plant
        if not entry.framers:
            return "yes"
        reason = obstruction(Problem.of(p, entry.tnl, getattr(entry.module, "SPLIT", False)))
    except DesignError as error:
        return str(error).removeprefix(f"{p.name}: ")
    return (f"not at this sample period: {reason}" if p.kind == "continuous" else reason) if reason else "yes"


def claims(design) -> None:
    """Print what was chosen and what is proved for the target's number type."""
    from .report.design_words import NEVER, finds_mode, sure_faults
    from .report.little_words import warnings
    from .report.mode_words import smallest_promises

    real = design.plant.target.real
    chosen = next(c for c in design.choice if c["chosen"])
    out.print(f"{design.plant.name}: {design.method}, {chosen['design']} (best of {len(design.choice)})")
    proved(design, {real: design.claims(real)})
    stays = " while the mode stays, as above" * finds_mode(design, real)
    promised = smallest_promises(design, real)
    for channel, unit, size, delay in sure_faults(design, real):
        within = "at once" if delay == 0 else f"within {delay} sample{'s' * (delay > 1)}"
        most = promised.get(channel, {}).get("upto")
        till = "on" if most is None else f"to {number(most)} {unit}".rstrip()
        words = f"{f'from {number(size)} {unit}'.rstrip()} {till}, {within}{stays}"
        out.print(f"  fault {channel}: surely detected: {NEVER if size is None else words}")
    for text in warnings(design, real):
        out.print(f"  warning: {text}", markup=False)


def proved(design, sentences: dict[str, list[str]]) -> None:
    """Print the proved claims per number type."""
    for real, lines in sentences.items():
        out.print(f"proved for {real}:")
        for line in lines:
            out.print(f"  {line}")


def outcomes(design, results) -> None:
    """Print the validation table."""
    claims(design)
    rows = table("\nvalidation", "scenario", "samples", "C == reference", "states lost", "false alarms", "assured",
                 "faults found")
    for o in results:
        found = [e for e in o.episodes if e.delay is not None]
        slowest = max((e.delay for e in found), default=None)
        words = f"{len(found)} of {len(o.episodes)}" if o.episodes else "-"
        words += f", at most {slowest} samples late" if slowest is not None else ""
        rows.add_row(o.scenario.name, str(len(o.trace.alarm)), "no" if o.differences else "yes", str(o.lost),
                     str(o.false_alarms + o.chance), f"{100 * np.mean(o.trace.assured):.1f} %", words)
    out.print(rows)


def campaign(design, rows) -> None:
    """Print what injected faults gave; delays in samples."""
    page = table("fault injection on the compiled C", "fault", "size", "runs", "false alarms", "found", "median delay",
                 "longest delay", "guaranteed")
    units = {f.name: f.unit for f in design.plant.f}
    for r in rows:
        share = f"{100 * len(r.delays) / r.runs:.1f} %" if r.channel else "-"
        late = [f"{np.median(r.delays):g}", f"{r.delays[-1]}"] if r.delays else ["-", "-"]
        size = f"{number(r.size)} {units[r.channel]}".rstrip() if r.channel else "-"
        page.add_row(r.channel or "none", size, str(r.runs), f"in {r.alarmed}" if r.alarmed else "0", share, *late,
                     f"in {r.promised} runs" if r.promised else "-")
    out.print(page)


def folder(path: Path) -> None:
    """Print where the results lie."""
    out.print(f"\nfirmware: {path}")
    for name in sorted(p.name for p in path.iterdir()):
        out.print(f"  {name}")
    out.print(f"report:   {path / 'report.html'}")


def replay(result) -> None:
    """Print the summary of a replay."""
    rows = table("replay", "", "")
    for name, value in result.rows():
        rows.add_row(name, value)
    out.print(rows)


def target(runs) -> None:
    """Print what the simulated boards gave; instructions (AVR: clock cycles) from least to most."""
    def span(count):
        return "-" if not count.calls else f"{count.least}" if count.least == count.most else \
            f"{count.least}-{count.most}"

    rows = table("golden self-test on simulated boards; instructions per call over its samples (AVR: cycles)", "board",
                 "what", "== host", "step", "ordinary step", "predict", "flash", "stack", "state")
    for r in runs:
        rows.add_row(r.board, r.words, "yes" if r.passed else "NO",
                     *(span(r.counts[kind]) for kind in ("step", "ordinary", "predict")), str(r.flash_bytes),
                     "-" if r.stack_bytes is None else str(r.stack_bytes), str(r.state_bytes))
    out.print(rows)


def proof(result) -> None:
    """Print what Frama-C proved, per function, and what it did not."""
    rows = table("proved by Frama-C Eva", "function", "contracts and assertions")
    for name, proved in sorted(result.properties.items()):
        rows.add_row(name, str(proved))
    out.print(rows)
    for alarm in result.alarms[:20]:  # those that others follow from come last
        out.print(f"not proved: {alarm}", markup=False)
    out.print(f"{sum(result.properties.values())} properties in {result.seconds:.1f} s, {result.coverage} % of the C "
              f"reached, {len(result.alarms)} alarms (Frama-C {result.version})")


def margins(result) -> None:
    """Print what Gappa proved about rounding, and what it did not."""
    for alarm in result.alarms[:20]:
        out.print(f"not proved: {alarm}", markup=False)
    out.print(f"rounding of {result.rows} sums {'within' if result.proved else 'not shown to be within'} the margins "
              f"of their offsets, in {result.seconds:.1f} s (Gappa {result.version})", markup=False)


def compared(p: Plant, found) -> None:
    """Print a comparison: what each variant promises and costs, then those without a design."""
    within = max((len(by) - 1 for c in found for by in c.faults or ()), default=0)
    faults = [f"{f.name} {when}" for f in p.f for when in ("at once", f"within {within}")]
    made = [c for c in found if not c.reason]
    rows = table(f"{p.name}: methods side by side", "method", "width", *faults, "mode lasts", "multiply-adds",
                 "instructions", "flash", "RAM", "stack")
    for c in made:
        sizes = [number(x) for by in c.faults for x in (by[0], by[-1])]
        rows.add_row(c.name, number(c.width), *sizes, "any" if not c.dwell else number(c.dwell),
                     *("-" if x is None else str(x) for x in (c.multiply, c.instructions, c.flash, c.ram, c.stack)))
    if made:
        out.print(rows)
        out.print("width: guaranteed, states in units of their ranges, summed; faults: smallest step surely detected, "
                  "- where none is proved, whatever the modes do; mode lasts: samples, for the "
                  "guarantee; multiply-adds: of the dearest call; instructions: of the dearest "
                  "ordinary step, Cortex-M4F in QEMU; flash, RAM, stack: bytes, "
                  f"{', '.join(sorted({c.chip for c in made}))} at -Os")
    groups: dict[str, list[str]] = {}
    for c in found:
        if c.reason:
            groups.setdefault(c.reason, []).append(c.name)
    for reason, names in groups.items():
        out.print(f"no design: {', '.join(names)}: {reason}", markup=False)


def methods(entries) -> None:
    """Print METHODS."""
    rows = table("methods", "method", "what", "plants", "source")
    rows.columns[0].no_wrap = True
    for name, m in entries.items():
        rows.add_row(name, m.summary, ", ".join(m.kinds), m.reference)
    out.print(rows)


def gallery(plants: list[Plant]) -> None:
    """Print the gallery."""
    rows = table("gallery", "plant", "what", "modes", "states", "source")
    rows.columns[0].no_wrap = True
    for p in plants:
        rows.add_row(p.name, p.title, str(p.n_modes) if p.polytope is None else _count(p), str(p.n_x), p.source)
    out.print(rows)


def fuzzed(found) -> None:
    """What fuzzing ran."""
    out.print(f"{found.folder}: {found.runs} sequences of calls, {found.edges} edges of the code reached, "
              f"{'a failure' if found.message else 'no failure'}")


def assurance(document: dict) -> None:
    """Print what an assurance file says: claims with their tightest margin and lines, then the checks."""
    rows = table("claims", "claim", "what", "tightest margin", "lines of C")
    for c in document["claims"]:
        least = min((m["margin"] for m in c["margins"]), default=None)
        places = [f"{file}: {', '.join(str(a) if a == b else f'{a}-{b}' for a, b in spans)}"
                  for file, spans in c["lines"].items() if spans]
        rows.add_row(c["id"], c["claim"], number(least), "; ".join(places) or "-")
    out.print(rows)
    rows = table("\nchecks", "check", "state", "what", "tool, or the command that runs it")
    for e in document["checks"]:
        rows.add_row(e["id"], e["state"], e["what"], e["tool"] if e["state"] in ("passed", "failed") else e["command"])
    out.print(rows)


def recorded(problem: str) -> None:
    """Say where a result could not be entered in assurance.json."""
    if problem:
        out.print(f"note: {problem}", markup=False)
