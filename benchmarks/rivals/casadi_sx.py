"""CasADi, scalar expressions (SX): straight-line code with its constants, one function per mode."""

from ..cases import Case
from . import _casadi

NEEDS, HEADER = "casadi", ""


def sources(case: Case) -> dict[str, str]:
    """Print a case."""
    return _casadi.sources(case, "SX")
