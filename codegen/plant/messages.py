"""Turns pydantic's validation errors into one line that names the place and says what to do."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any

from pydantic import BaseModel, ValidationError

from codegen.plant.schema import PlantFile
from codegen.plant.values import shown

_EXPECTED = {
    "float_type": ("a number", "Write a number"),
    "finite_number": ("a finite number", "Write a finite number"),
    "int_type": ("a whole number", "Write a whole number"),
    "int_from_float": ("a whole number", "Write a whole number"),
    "string_type": ("a string", "Put it in quotes"),
    "bool_type": ("true or false", "Write true or false"),
    "list_type": ("a list", "Write it in [ ]"),
    "dict_type": ("a table", "Write it in { }"),
    "model_type": ("a table", "Write it in { }, or as a [table]"),
}
# Keys that belong to a neighbouring table and are no misspelling of anything.
_OTHER_NAME = {"range": "bounds", "bounds": "range", "values": "value", "modes": "mode", "gain": "method"}


def first_error(error: ValidationError, raw: dict[str, Any]) -> str:
    """Return the first error as ``place: what (found, expected). What to do.``

    Parameters
    ----------
    error : ValidationError
        Of `PlantFile`.
    raw : dict
        The parsed TOML; gives modes and signals their names.

    Returns
    -------
    message : str
    """
    errors = error.errors(include_url=False)
    first = errors[0]
    if first["type"] == "missing":
        # A misspelt key is reported twice, as missing and as unknown; the second says what to do.
        siblings = [
            e for e in errors if e["type"] == "extra_forbidden" and e["loc"][:-1] == first["loc"][:-1]
        ]
        first = next((e for e in siblings if "Did you mean" in _message(e)), first)
        errors = [e for e in errors if e is first or e not in (errors[0], *siblings)]
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    # A missing or unknown key is named in the message, so the place is the table that it belongs to.
    path = first["loc"][:-1] if first["type"] in ("missing", "extra_forbidden") else first["loc"]
    place = _location(path, raw)
    return (f"{place}: " if place else "") + _message(first) + more


def unknown(what: str, name: str, known: Iterable[str]) -> str:
    """Return the message for a name that is not among the known ones, with the nearest suggested.

    Parameters
    ----------
    what : str
        What is named, e.g. "mode".
    name : str
        The name found.
    known : iterable of str
        The names declared.

    Returns
    -------
    message : str
    """
    known = list(known)
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    advice = f'Did you mean "{near[0]}"?' if near else "Use one of these."
    if not known:
        return f"unknown {what} {shown(name)} (none is declared). Declare it, or leave it out."
    return f"unknown {what} {shown(name)} (known: {', '.join(known)}). {advice}"


def _message(error: dict[str, Any]) -> str:
    kind, found = error["type"], shown(error["input"])
    context = error.get("ctx", {})
    key = str(error["loc"][-1])
    match kind:
        case "missing":
            return f'the key "{key}" is missing. Add it.'
        case "extra_forbidden":
            return _unknown_key(key, error["loc"])
        case "value_error":
            return f"{context['error']}."
        case "list_type" if key in ("mode", "vertex", "scenario"):
            return f"is one table (expected a list of them). Write [[{key}]]."
        case "literal_error":
            return f"is {found} (expected {context['expected']}). Use one of these."
        case "too_short":
            return f"is empty (expected at least {context['min_length']}). Declare one."
        case "greater_than" | "greater_than_equal":
            sign, bound = (">", context["gt"]) if kind == "greater_than" else (">=", context["ge"])
            return f"is {found} (expected a number {sign} {bound:g}). Correct it."
    expected, advice = _EXPECTED.get(kind, (error["msg"], "Correct it"))
    return f"is {found} (expected {expected}). {advice}."


def _unknown_key(key: str, location: tuple) -> str:
    known = _known_keys(location[:-1])
    other = _OTHER_NAME.get(key)
    if other in known:
        return f'unknown key "{key}" (known: {", ".join(known)}). Did you mean "{other}"?'
    return unknown("key", key, known)


def _known_keys(location: tuple) -> list[str]:
    """The keys of the table at a place, found by walking the models along it."""
    model: type[BaseModel] = PlantFile
    for step in location:
        if isinstance(step, int):
            continue
        fields = {info.alias or name: info for name, info in model.model_fields.items()}
        inner = _model_in(fields[step].annotation) if step in fields else None
        if inner is None:
            return []
        model = inner
    return [info.alias or name for name, info in model.model_fields.items()]


def _model_in(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((m for a in getattr(annotation, "__args__", ()) if (m := _model_in(a))), None)


def _location(location: tuple, raw: Any) -> str:
    """``("mode", 1, "A")`` as ``modes.braked.A``: list elements go by their names where they have one."""
    parts: list[str] = []
    value = raw
    for step in location:
        if isinstance(step, int):
            element = value[step] if isinstance(value, list) and step < len(value) else None
            name = element.get("name") or element.get("channel") if isinstance(element, dict) else None
            parts.append(shown(name)[1:-1] if isinstance(name, str) else f"#{step + 1}")
            value = element
        else:
            parts.append(
                {"mode": "modes", "scenario": "scenarios", "vertex": "vertices"}.get(step, step) if not parts
                else str(step)
            )
            value = value.get(step) if isinstance(value, dict) else None
    return ".".join(parts)
