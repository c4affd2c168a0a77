"""Run-time families: one recursion per file, the numpy step that the C must equal bit for bit."""

from .bank import BankObserver, BankTrace
from .bank_tables import BankTables
from .blocks import BlockObserver, BlockTables
from .box import BoxObserver, BoxTables
from .coordinates import Coordinates
from .descriptor import DescriptorObserver
from .descriptor_tables import DescriptorTables
from .driven import DrivenObserver, DrivenTables
from .ellipsoid import EllipsoidObserver, EllipsoidTables
from .ellipsoid_trace import EllipsoidTraceObserver, TraceTables
from .filter import FilterObserver, FilterTables
from .follower import FollowerObserver, FollowerTables, FollowerTrace
from .framer import FramerTables, Variation
from .guided import GuidedObserver, GuidedTables
from .guided_filter import GuidedFilterObserver, GuidedFilterTables, GuidedFilterTrace
from .guided_point import GuidedPointObserver, GuidedPointTables, GuidedPointTrace
from .interval import IntervalObserver
from .loose_filter import LooseFilter
from .mode_observer import ModeObserver, ModeTrace
from .mode_tables import ModeTables
from .point import PointObserver, PointTables
from .polytopic import PolytopicObserver, PolytopicTrace
from .polytopic_tables import PolytopicTables
from .runner import Runner
from .schedule import ScheduleObserver, ScheduleTables
from .sliding import SlidingObserver, SlidingTrace
from .sliding_tables import SlidingTables
from .starts import StartObserver, StartTables
from .supervisor import Supervision
from .thresholds import ThresholdObserver, ThresholdTables
from .tnl import TnlObserver
from .trace import FilterTrace, PointTrace, Trace
from .trailing import TrailingObserver, TrailingTables, TrailingTrace
from .zonotope import ZonotopeObserver, ZonotopeTables

FAMILIES = {"interval": IntervalObserver, "tnl": TnlObserver, "zonotope": ZonotopeObserver,
            "thresholds": ThresholdObserver, "schedule": ScheduleObserver, "blocks": BlockObserver,
            "ellipsoid": EllipsoidObserver, "box": BoxObserver, "ellipsoid_trace": EllipsoidTraceObserver,
            "filter": FilterObserver, "mode": ModeObserver, "driven": DrivenObserver, "follower": FollowerObserver,
            "polytopic": PolytopicObserver, "descriptor": DescriptorObserver, "bank": BankObserver,
            "sliding": SlidingObserver, "guided": GuidedObserver, "guided_point": GuidedPointObserver,
            "guided_filter": GuidedFilterObserver,
            "trailing": TrailingObserver}

__all__ = ["FAMILIES", "BankObserver", "BankTables", "BankTrace", "BlockObserver", "BlockTables", "BoxObserver",
           "BoxTables", "Coordinates", "DescriptorObserver", "DescriptorTables", "DrivenObserver", "DrivenTables",
           "EllipsoidObserver", "EllipsoidTables", "EllipsoidTraceObserver", "FilterObserver", "FilterTables",
           "FilterTrace", "FollowerObserver", "FollowerTables", "FollowerTrace", "FramerTables",
           "GuidedFilterObserver", "GuidedFilterTables", "GuidedFilterTrace", "GuidedObserver",
           "GuidedPointObserver", "GuidedPointTables", "GuidedPointTrace", "GuidedTables", "IntervalObserver",
           "LooseFilter", "ModeObserver", "ModeTables", "ModeTrace", "PointObserver", "PointTables", "PointTrace",
           "PolytopicObserver", "PolytopicTables", "PolytopicTrace", "Runner", "ScheduleObserver", "ScheduleTables",
           "SlidingObserver", "SlidingTables", "SlidingTrace", "StartObserver", "StartTables", "Supervision",
           "ThresholdObserver", "ThresholdTables", "TnlObserver", "Trace", "TraceTables", "TrailingObserver",
           "TrailingTables", "TrailingTrace", "Variation", "ZonotopeObserver", "ZonotopeTables"]
