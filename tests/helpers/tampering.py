"""Copies of tables and designs, as dictionaries, with one place changed."""

from __future__ import annotations

import copy


def altered(data: dict, path, change) -> dict:
    """A copy with another value in one place."""
    data = copy.deepcopy(data)
    *way, last = path
    place = data
    for key in way:
        place = place[key]
    new = change(place[last])
    assert new is not None and new != place[last], path
    place[last] = new
    return data


def scaled(data: dict, path, factor) -> dict:
    """A copy with one number, or all of a list, scaled; a whole number is put in the place of another."""
    def change(value):
        return [change(v) for v in value] if isinstance(value, list) else value * factor

    return altered(data, path, lambda value: factor if isinstance(value, int) else change(value))
