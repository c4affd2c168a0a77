"""Options of a point observer that contradict each other, or that nothing would read: refused, each with the reason."""

from __future__ import annotations

from ..errors import DesignError

#: Options that count something.
WHOLE = ("order", "rows", "stages", "directions", "within")


def check_set_options(where: str, options: dict, family: str, n_y: int) -> None:
    """Refuse options of the set that are no whole numbers, and those that the set at hand does not read.

    Parameters
    ----------
    where : str
        The plant's name.
    options : dict
        Of ``[observer]``, each within its own limits.
    family : str
        Of the method: its set where the options name none.
    n_y : int
        Outputs.

    Raises
    ------
    DesignError
    """
    for key in WHOLE:
        if key in options and options[key] != int(options[key]):
            raise DesignError(f"{where}: observer.{key} is {options[key]:g}, expected a whole number.")
    tables = options.get("tables", "none")
    at_hand = f'set = "{options.get("set", family)}"' if tables == "none" else f'tables = "{tables}"'
    for key, (read, wanted) in readers(options, family).items():
        if key in options and not read:
            raise DesignError(f"{where}: observer.{key} is given with {at_hand}, which does not read it; expected "
                              f"{wanted}. Remove one of them.")
    if "directions" in options and n_y != 2:
        raise DesignError(f"{where}: observer.directions is given for {n_y} output{'' if n_y == 1 else 's'}, expected "
                          "two: for others the directions are found. Remove it.")
    if options.get("directions", 2) % 2:
        raise DesignError(f"{where}: observer.directions is {options['directions']}, expected an even number: both "
                          "coordinates are among them.")


def readers(options: dict, family: str) -> dict[str, tuple[bool, str]]:
    """Return whether each option is read, and with what it would be.

    Parameters
    ----------
    options : dict
    family : str

    Returns
    -------
    dict
        Option -> (read, with what).
    """
    tables, kind = options.get("tables", "none"), options.get("set", family)
    return {"set": (tables == "none", 'tables = "none"'),
            "order": (tables == "arbitrary" or (tables == "none" and kind == "zonotope"), 'set = "zonotope"'),
            "weights": (tables == "none" and kind == "ellipsoid", 'set = "ellipsoid"'),
            "membership": (tables == "none" and kind == "zonotope", 'set = "zonotope"'),
            "rows": (tables != "none", 'tables other than "none"'), "stages": (tables == "dwell", 'tables = "dwell"'),
            "directions": (tables != "none", 'tables other than "none"')}
