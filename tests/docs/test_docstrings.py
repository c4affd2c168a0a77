"""Public names explain themselves in numpydoc: what goes in, what comes out, what is raised, where it is from."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re

import pytest

import codegen
from codegen import METHODS


def modules():
    names = [m.name for m in pkgutil.walk_packages(codegen.__path__, "codegen.") if "__main__" not in m.name]
    return [importlib.import_module(name) for name in names]


def public():
    """Every public function and class defined in our modules, with its qualified name."""
    for module in modules():
        for name, thing in vars(module).items():
            own = getattr(thing, "__module__", None) == module.__name__
            if own and not name.startswith("_") and (inspect.isfunction(thing) or inspect.isclass(thing)):
                yield f"{module.__name__}.{name}", thing


def test_every_module_and_public_name_has_a_docstring():
    missing = [m.__name__ for m in modules() if not (m.__doc__ or "").strip()]
    missing += [name for name, thing in public() if not (inspect.getdoc(thing) or "").strip()]
    assert not missing


API = [n for n in codegen.__all__ if n not in ("__version__", "METHODS")]


@pytest.mark.parametrize("name", API)
def test_api_functions_have_their_sections(name):
    function = getattr(codegen, name)
    doc = inspect.getdoc(function)
    assert re.search(r"^Parameters\n-+$", doc, re.M), name
    assert re.search(r"^Returns\n-+$", doc, re.M), name
    assert re.search(r"^Raises\n-+$", doc, re.M), name
    for parameter in inspect.signature(function).parameters.values():
        assert re.search(rf"^\**{parameter.name}\b|, {parameter.name}\b", doc, re.M), f"{name}: {parameter.name}"


def test_array_arguments_state_their_shapes():
    for name, thing in public():
        for line in (inspect.getdoc(thing) or "").splitlines():
            if re.match(r"^\w[\w, ]* : ndarray", line):
                assert re.search(r"ndarray.*\(.*\)", line), f"{name}: {line}"


@pytest.mark.parametrize("name", list(METHODS))
def test_every_method_names_its_source_and_its_differences(name):
    doc = METHODS[name].module.__doc__
    for word in ("Plant", "observer", "Source:", "Differences from the print"):
        assert word in doc, f"{name}: {word}"
    assert METHODS[name].reference and METHODS[name].summary
