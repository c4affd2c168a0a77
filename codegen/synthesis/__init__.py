"""Published designs, one per file. METHODS is the list of what the tool can do."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

from . import interval, tnl_interval
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


METHODS = {
    "interval": Method(("discrete switched",), "interval", "classical fault-detection interval observer",
                       "Zammali (2020), Theorems 13, 14, 17", interval),
    "tnl-interval": Method(("discrete switched",), "tnl", "interval observer with T, N, L structure",
                           "Zammali (2020), Theorems 15, 16, 18", tnl_interval),
}

__all__ = ["METHODS", "Method", "check_options"]
