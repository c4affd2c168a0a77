"""The independent checker (codegen/certify/independent*.py) in this process, and what it has to refuse."""

from __future__ import annotations

import json
import re
import sys

import pytest

from .scripts import ROOT

CHECKER = ROOT / "codegen" / "certify" / "independent.py"


def checker_of(*names: str):
    """Return a fixture of a test module: ``independent_<name>.py``, or several by name.

    Their folder is on the path as long, as some import others only when they are called.
    """
    @pytest.fixture(scope="module")
    def given():
        sys.path.insert(0, str(CHECKER.parent))
        try:
            found = {name: __import__(f"independent_{name}") for name in names}
            yield found if len(names) > 1 else found[names[0]]
        finally:
            sys.path.remove(str(CHECKER.parent))
    return given


def refuses_changes(check, text: str, changes) -> None:
    """``check`` is content with the C, and with none in which one (pattern, new) is changed."""
    check(text)
    for pattern, new in changes:
        other, count = re.subn(pattern, new, text, count=1)
        assert count == 1 and other != text, pattern
        with pytest.raises(SystemExit, match="refused: "):
            check(other)
            pytest.fail(pattern)


def is_proved(checker, design, printed, folder) -> dict:
    """Return what is proved, in float32: a design guided by sliding modes, whose part hands it over, and its C."""
    data = json.loads(design.to_json())
    for name in ("tables", "certificate"):
        data[name] = {"float32": data[name]["float32"]}
    for end, text in zip("ch", printed):
        (folder / f"valve.{end}").write_text(text)
    assert checker.sliding.main(folder, data, {"prefix": "valve", "real": "float32"}) == 0
    return data
