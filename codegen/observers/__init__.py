"""Run-time families: one recursion per file, the numpy step that the C must equal bit for bit."""

from .coordinates import Coordinates
from .framer import FramerTables, Variation
from .interval import IntervalObserver
from .supervisor import Supervision
from .tnl import TnlObserver
from .trace import Trace

FAMILIES = {"interval": IntervalObserver, "tnl": TnlObserver}

__all__ = ["FAMILIES", "Coordinates", "FramerTables", "IntervalObserver", "Supervision", "TnlObserver", "Trace",
           "Variation"]
