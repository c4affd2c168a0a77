"""From a certified design to C99 text: Python decides and prints every number, templates hold the C."""

VERSION = "0.1.0"  # of the generator, for the banner; a test compares it with pyproject.toml

from .package import files, generate  # noqa: E402  (package reads VERSION)

__all__ = ["VERSION", "files", "generate"]
