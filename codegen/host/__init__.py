"""The generated C on the host: compiled with gcc, driven from numpy."""

from .build import build
from .drive import Driver

__all__ = ["Driver", "build"]
