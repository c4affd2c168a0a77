"""``python -m codegen`` is the command ``residua``."""

from .cli import main

main(prog_name="residua")
