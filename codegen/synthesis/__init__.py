"""Published designs, one per file. METHODS is the list of what the tool can do."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

from ..errors import DesignError
from . import (
    bank,
    component_interval,
    descriptor_direct,
    descriptor_discrete,
    descriptor_error,
    descriptor_fault_estimation,
    descriptor_uncertain,
    ellipsoid,
    fault_filter,
    hminus_hinf,
    interval,
    lpv_interval,
    mode_set,
    mode_sliding,
    tnl_interval,
    tnl_interval_lpv,
    tracking,
    zonotope,
)
from .framers import OPTIONS, check_options


@dataclass(frozen=True)
class Method:
    """One entry of METHODS.

    Parameters
    ----------
    kinds : tuple of str
        Plant kinds it takes.
    family : str
        Run-time family in ``observers``.
    summary, reference : str
    module : module
        ``candidates(plant, ...)`` and ``inapplicable(plant)``.
    automatic : bool
        Tried where the plant file names no method.
    """

    kinds: tuple[str, ...]
    family: str
    summary: str
    reference: str
    module: ModuleType

    automatic: bool = True

    @property
    def framers(self) -> bool:
        """Whether the observer is a pair of framers."""
        return self.family in ("interval", "tnl")

    @property
    def sets(self) -> bool:
        """Whether it is an estimate with an error set, which the options ``SETS`` choose."""
        return not (self.framers or self.estimates_mode or self.family in ("filter", "polytopic", "descriptor", "bank"))

    @property
    def finds(self) -> bool:
        """Whether it is no pair of framers and may find its mode itself, which the options ``FINDING`` choose."""
        return self.sets or self.family == "filter"

    @property
    def estimates_mode(self) -> bool:
        """Whether it finds the mode that other observers are told."""
        return self.family in ("mode", "sliding")

    @property
    def tnl(self) -> bool:
        """Whether N is a variable of the design."""
        return self.family == "tnl"

    def family_for(self, plant) -> str:
        """Run-time family for a plant: some methods take another one for a sampled plant."""
        if plant.switching.late:
            return "tnl"  # only there the step waits for what the next sample tells
        choose = getattr(self.module, "family_for", None)
        return self.family if choose is None else choose(plant)


METHODS = {
    "interval": Method(("discrete switched",), "interval", "classical fault-detection interval observer",
                       "Zammali (2020), Theorems 13, 14, 17", interval),
    "tnl-interval": Method(("discrete switched",), "tnl", "interval observer with T, N, L structure",
                           "Zammali (2020), Theorems 15, 16, 18", tnl_interval),
    "lpv-interval": Method(("discrete LPV", "continuous LPV"), "interval", "interval observer scheduled by parameters",
                           "Zammali (2020), Theorems 6 to 10", lpv_interval),
    "tnl-interval-lpv": Method(("discrete LPV", "continuous LPV"), "tnl",
                               "T, N, L interval observer for parameters that are not measured",
                               "Chevet (2021)", tnl_interval_lpv),
    "component-interval": Method(("discrete LPV", "continuous LPV"), "interval",
                                 "interval observer for bounded changes of the plant", "Lamouchi (2016)",
                                 component_interval),
    "zonotope": Method(("discrete switched", "continuous switched"), "zonotope",
                       "point observer, residual set a zonotope",
                       "Zammali (2020), Theorems 19, 20", zonotope, automatic=False),
    "ellipsoid": Method(("discrete switched", "continuous switched"), "ellipsoid",
                        "point observer, residual set an ellipsoid",
                        "Zammali (2020), Theorem 21", ellipsoid, automatic=False),
    "hinf-filter": Method(("discrete switched", "discrete LPV", "continuous switched"), "filter",
                          "filter that estimates faults, H-infinity",
                          "Farhat, Koenig (2016)", fault_filter, automatic=False),
    "descriptor-direct": Method(("continuous polytopic descriptor",), "descriptor",
                                "observer that solves the algebraic equations itself, H-infinity",
                                "Lopez-Estrada (2014), Corollary 3.2.1", descriptor_direct, automatic=False),
    "descriptor-uncertain": Method(("continuous polytopic descriptor",), "polytopic",
                                   "observer with weights at its estimate, mismatch as uncertainty, H-infinity",
                                   "Lopez-Estrada (2014), Theorem 3.3.1", descriptor_uncertain, automatic=False),
    "descriptor-error": Method(("continuous polytopic descriptor",), "polytopic",
                               "observer with weights at its estimate, error centred at each vertex, H-infinity",
                               "Lopez-Estrada (2014), Theorem 3.4.2", descriptor_error, automatic=False),
    "descriptor-discrete": Method(("continuous or discrete polytopic descriptor",), "polytopic",
                                  "observer with weights at its estimate, designed in discrete time",
                                  "Lopez-Estrada (2014), Theorem C.2.1", descriptor_discrete, automatic=False),
    "descriptor-fault-estimation": Method(("continuous or discrete polytopic descriptor",), "polytopic",
                                          "states and sensor faults, weights of exact measurements or at the estimate",
                                          "Lopez-Estrada (2014), Theorem 3.7.1", descriptor_fault_estimation,
                                          automatic=False),
    "hminus-hinf": Method(("continuous polytopic descriptor",), "polytopic",
                          "detection observer with weights at its estimate, H- and H-infinity",
                          "Lopez-Estrada (2014), Theorem 4.3.3", hminus_hinf, automatic=False),
    "tracking": Method(("continuous polytopic, E = I",), "polytopic",
                       "detection observer and tracking law with integral action, as one unit",
                       "Lopez-Estrada (2014), Theorems C.1.1, C.1.2", tracking, automatic=False),
    "bank": Method(("continuous or discrete polytopic descriptor",), "bank",
                   "one detection observer per sensor fault: tells which",
                   "Lopez-Estrada (2014), sections 3.6 and 4.3", bank, automatic=False),
    "mode-set": Method(("switched, mode unknown",), "mode", "the modes that are still possible",
                       "own; task of Zammali (2020), chapter 4", mode_set, automatic=False),
    "mode-sliding": Method(("continuous switched, mode unknown",), "sliding", "the mode by super-twisting, unproved",
                           "Zammali (2020), Theorem 12", mode_sliding, automatic=False),
}
#: Options of every method with an error set.
SETS = {"set": ("zonotope", "ellipsoid", "interval"), "order": (2, 200),
        "tables": ("none", "schedule", "dwell", "arbitrary"), "rows": (1, 200), "stages": (3, 50),
        "directions": (2, 64), "weights": ("fixed", "trace"),
        "membership": ("auto", "exact", "directions"), "gains": dict}
#: Options of those that find the mode themselves.
FINDING = {"modes": ("set", "sliding"), **mode_set.OPTIONS, **mode_sliding.OPTIONS}


def known_options(methods: list[str]) -> dict:
    """Options that some of the methods read, with what they may be; words of several methods are joined."""
    known: dict = {}
    for name in methods:
        entry = METHODS[name]
        own = OPTIONS if entry.framers else (
            (SETS if entry.sets else {}) | (FINDING if entry.finds else {}) | entry.module.OPTIONS)
        for key, allowed in own.items():
            words = isinstance(allowed, tuple) and isinstance(allowed[0], str)
            known[key] = tuple(dict.fromkeys((*known.get(key, ()), *allowed))) if words else allowed
    return known


def check_modes(where: str, options: dict, method: str | None) -> None:
    """Refuse options of the mode estimator that is not the one at hand, which nothing would read.

    Raises
    ------
    DesignError
    """
    if method and METHODS[method].estimates_mode:
        return
    asked = options.get("modes", "set")
    for word, module in (("set", mode_set), ("sliding", mode_sliding)):
        for key in module.OPTIONS if word != asked else ():
            if key in options and not (method and key in getattr(METHODS[method].module, "OPTIONS", ())):
                raise DesignError(f'{where}: observer.{key} is given, which modes = "{word}" alone reads. Remove '
                                  "it, or let the mode be found that way.")


__all__ = ["METHODS", "Method", "check_modes", "check_options", "known_options"]
