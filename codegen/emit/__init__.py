"""From a certified design to C99 text: Python decides and prints every number, templates hold the C."""

from .package import files, firmware, generate, publish

__all__ = ["files", "firmware", "generate", "publish"]
