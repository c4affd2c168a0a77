"""Published designs, one per file. METHODS is the list of what the tool can do."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

from . import component_interval, interval, lpv_interval, tnl_interval, tnl_interval_lpv
from .framers import check_options


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
    """

    kinds: tuple[str, ...]
    family: str
    summary: str
    reference: str
    module: ModuleType

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
}

__all__ = ["METHODS", "Method", "check_options"]
