"""The claims of a mode estimator: what each rests on, by how much it holds."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from flint import fmpq

from ..certify import mode_certificate
from ..certify.exact import Q
from ..certify.mode_steps import check_enclosure
from ..plant.bounded import bounded
from .margins import Margin, tightest

BOXES = ("Phi", "Gamma", "shift", "reach", "J", "J_u", "J_shift", "J_radius", "J_u_radius", "J_reach", "birth", "limit")
#: What leaves its bounds where a fault is found, and the constants behind that: none is promised to be found.
SEEN = ("output", (*BOXES, "D", "v"))
PLANT = ("time.kind", "time.sample_period")
DWELL = ("switching.minimum_dwell", "switching.average_dwell")
#: Conditions of the enclosure by what they are about; the others are where the boxes start.
HELD = {"v": "bounds of y - D u beyond those of C x and its noise", "x_room": "room of the answer beyond rounding",
        "reach": "reach beyond disturbance, rounded matrices and sums",
        "jump": "radius of a jump beyond the integrand over the period", "birth": "reach of a birth beyond its demand"}
STARTS = {"start": "box of init beyond the declared one", "wide": "box of a restart beyond the declared range",
          "limit": "limit beyond the boxes to start from"}


def of_certificate(design, t, cert: dict, build: type, plant: tuple, own: tuple) -> Iterator[tuple[str, Callable]]:
    """Yield what ``claims.OwnClaims`` says, in the order of ``mode_certificate.sentences``."""
    unseen = tuple(name for name in own if name != "independent")  # without the multipliers that prove them
    exact = own if "witnesses" in cert else unseen
    hidden = own if any(name.startswith("fault") for name in cert.get("witnesses", ())) else unseen
    rooms = _rooms(design, t, HELD)  # before the delays, which rest on tables that hold the plant
    found = mode_certificate.proved(bounded(design.plant), t, cert)
    story = ("every story in which a wrong hypothesis lives longer is a linear program without solution: the true mode "
             "and its switch, inputs, measurements and the box of the hypothesis at every sample; a witness is checked "
             "in rational numbers")

    def claim(id, words, formula, margins, code="codegen.certify.mode_claims.Claims.again", constants=(*BOXES, "v"),
              checks=(*exact, "validation")):
        return lambda text: build(id, text, (*plant, *PLANT, *DWELL), words, formula,
                                  "own derivation: the scheme of this family (codegen.observers.mode_set)", code,
                                  constants, tuple(margins), checks)

    def stated(name: str, what: str) -> Margin:
        given, fresh = cert[name], getattr(found, name)
        if not isinstance(fresh, dict):
            return Margin(what, fmpq(given - fresh))
        names = [m.name for m in design.plant.modes]
        return tightest(what, [(fmpq(given[i][j] - samples), f'from "{names[i]}" to "{names[j]}"')
                               for (i, j), samples in fresh.items()])

    yield "the true mode is in mode_set", claim(
        "containment", "The box of the true mode, and of each that begins within a period, holds the true state after "
        "every sample: disturbance, the instant of the switch, rounded constants and sums are in what boxes gain.",
        "reach >= |int S e^(A s) w| + lost constants + gamma_k (terms); the jump within J +- J_radius over all of the "
        "period; v, x_room alike for the measurement and the answer", rooms,
        "codegen.certify.mode_steps.check_enclosure", (*BOXES, "D", "v", "x_room", "S_inverse"),
        (*own, "validation", "target"))
    yield "a switch is identified within", claim(
        "identified", "After a switch every wrong hypothesis as old as the switch is dead in time: " + story + ".",
        "identified <= worst <= dwell", [stated("worst", "worst delay beyond the proved one"), Margin(
            "dwell time beyond the worst delay", fmpq(cert["dwell"] - cert["worst"]))])
    yield "samples after which the old mode is out", claim(
        "delays", "Of each pair of modes: " + story + ".",
        "min over the box of y' A z > y' b, y >= 0, for the program A z <= b of the story one sample longer",
        [stated("old", "delay of the old mode beyond the proved one"),
         stated("identified", "delay of the decision beyond the proved one")])
    yield "from power-up within the initial box", claim(
        "start", "From power-up every wrong hypothesis as old as that is dead in time: " + story + ".",
        "the same programs, begun in the initial box", [stated("start", "delay from power-up beyond the proved one")],
        constants=(*BOXES, "v", "start"))
    yield "a wrong mode that is taken up while the mode stays", claim(
        "quiet", "No wrong hypothesis grows old enough to give birth itself: " + story + ".",
        "quiet < ages + 1", [Margin("oldest age beyond the last one of a wrong hypothesis", fmpq(
            cert["ages"] - cert["quiet"])), stated("quiet", "age beyond the proved one")])
    if "restart" in cert:
        yield "after a reset, and after an alarm", claim(
            "restart", "From the declared range every wrong hypothesis is dead in time: " + story + ".",
            "the same programs, begun in the declared range",
            [stated("restart", "delay after an alarm beyond the proved one"),
             stated("calm", "samples until all holds again beyond the proved ones")], constants=(*BOXES, "v", "wide"))
    for f in cert.get("faults", ()):
        acts = design.plant.acts_on_state(f["channel"])
        unread = acts and design.plant.theta and design.plant.kind == "continuous"  # by the checker that is independent
        yield f'a step of the fault "{f["channel"]}"', claim(
            f"found-{f['channel']}" + (f"-{f['within']}" if f["within"] > 1 else ""),
            "What is possible so many samples after the fault came would have lived through it: the largest fault with "
            "which the true mode, or a child of it, can is a linear program; no wrong child lives to the oldest age.",
            "size > y' b + max over the box of (f - y' A z), y >= 0, for the program A z <= b of every story with a "
            f"constant fault f on y{' and S x' if acts else ''}, 0 <= f <= the largest size, either sign",
            [Margin("samples of the promise beyond those of the proof", fmpq(
                f["after"] - cert["dwell"] - cert["quiet"]))],
            "codegen.certify.mode_faults.surely_found", (*BOXES, "v"), (*(unseen if unread else hidden), "validation"))


def ranges(design, t, cert: dict, build: type, checks: tuple):
    """State where the boxes start."""
    return build("ranges", "the boxes that init and reset start from hold what the plant file declares",
                 ("signals.x", "initial.x_lo", "initial.x_hi"), "S x of each box is rounded outward.",
                 "start holds S [x0_lo, x0_hi], wide holds S [x_lo, x_hi], limit >= both in magnitude",
                 "own derivation: Start and restart hold what is declared; what boxes are cut to holds both.",
                 "codegen.certify.mode_enclosure.Enclosure.boxes", ("start", "wide", "limit"),
                 _rooms(design, t, STARTS), checks)


def _rooms(design, t, kinds: dict[str, str]) -> tuple[Margin, ...]:
    """The tightest condition of each kind."""
    rooms = check_enclosure(bounded(design.plant), t)
    return tuple(tightest(text, [(Q(left), where) for name, left, where in rooms if name == kind])
                 for kind, text in kinds.items())
