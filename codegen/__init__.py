"""residua: from a model of a switched system to fault-detection firmware with proven bounds.

The public names; the command line is a thin layer over them. Heavy modules are imported on first use.
"""

from __future__ import annotations

from importlib import import_module

__version__ = "0.1.0"

_WHERE = {
    "load": "codegen.plant.load", "loads": "codegen.plant.load", "plant_from": "codegen.plant.load",
    "simulate": "codegen.plant.simulate", "design": "codegen.pipeline", "generate": "codegen.pipeline",
    "build": "codegen.host.build", "read_design": "codegen.designs", "METHODS": "codegen.synthesis",
    "run": "codegen.pipeline",
}

__all__ = sorted([*_WHERE, "__version__"])


def __getattr__(name: str):
    """Import a public name on first use."""
    if name not in _WHERE:
        raise AttributeError(f"module 'codegen' has no attribute {name!r}")
    return getattr(import_module(_WHERE[name]), name)
