"""Tools outside Python: a missing one skips the test on a user's machine and fails it on CI."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import pytest


def need(*tools: str) -> None:
    """Skip (a test, or a module that calls it at its top), or fail where CI is set, unless every tool is there.

    Looked for on the PATH and beside this Python, where pip puts its tools.
    """
    path = os.pathsep.join([os.environ.get("PATH", ""), str(Path(sys.executable).parent)])
    missing = [tool for tool in tools if not shutil.which(tool, path=path)]
    if missing and os.environ.get("CI"):
        pytest.fail(f"{', '.join(missing)} is missing; on CI every check must run")
    if missing:
        pytest.skip(f"{', '.join(missing)} is not installed here", allow_module_level=True)
