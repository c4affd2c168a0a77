"""Tools outside Python: a missing one skips the test on a user's machine and fails it on CI."""

from __future__ import annotations

import os
import shutil

import pytest


def need(*tools: str) -> None:
    """Skip, or fail where CI is set, unless every tool is on the PATH."""
    missing = [tool for tool in tools if not shutil.which(tool)]
    if missing and os.environ.get("CI"):
        pytest.fail(f"{', '.join(missing)} is missing; on CI every check must run")
    if missing:
        pytest.skip(f"{', '.join(missing)} is not installed here")
