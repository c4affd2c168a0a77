"""The ways to a Plant: a file, a text, the gallery, or the objects of another toolbox."""

from __future__ import annotations

import difflib
import re
from functools import lru_cache
from pathlib import Path

from codegen.errors import PlantError
from codegen.plant.build import build
from codegen.plant.model import Plant
from codegen.plant.names import check_plant_name
from codegen.plant.objects import plant_from

__all__ = ["gallery_folder", "gallery_names", "load", "loads", "plant_from", "starter"]

_GALLERY = Path(__file__).parents[1] / "gallery"
_STARTER = Path(__file__).with_name("starter.toml")


def load(plant: str | Path) -> Plant:
    """Read and check a plant file.

    Parameters
    ----------
    plant : str or Path
        A path, or the name of a gallery plant; an existing file goes before a gallery plant of its name.

    Returns
    -------
    plant : Plant

    Raises
    ------
    PlantError
        The file is missing, a folder, unreadable, no UTF-8 text, or says something wrong; the message
        names the
        file and the place.

    Examples
    --------
    >>> load("cart").n_modes
    2
    """
    path = Path(plant)
    if not path.is_file() and str(plant) in gallery_names():
        path = _GALLERY / f"{plant}.toml"
    text = _text(path, str(plant))
    return _of_gallery(text, path.name) if path.parent == _GALLERY else loads(text, str(plant), str(path.parent))


def loads(text: str, name: str = "<text>", folder: str = "", scenarios: bool = True) -> Plant:
    """Check a plant given as TOML text.

    Parameters
    ----------
    text : str
    name : str
        What messages call the text.
    folder : str
        Where CSV records are looked for, before the gallery's data.
    scenarios : bool
        False leaves the scenarios out (for a design that is read back where its CSV records are not).

    Returns
    -------
    plant : Plant

    Raises
    ------
    PlantError
        Anything wrong with the text.
    """
    try:
        return build(text, folder, scenarios)
    except PlantError as error:
        raise PlantError(f"{name}: {error}") from None


@lru_cache(maxsize=64)
def _of_gallery(text: str, name: str) -> Plant:
    """A plant of the gallery, checked once: sectors of nonlinear equations take a second."""
    return loads(text, name, str(_GALLERY))


def gallery_folder() -> Path:
    """Return the folder of the gallery plants.

    Returns
    -------
    folder : Path
    """
    return _GALLERY


def gallery_names() -> list[str]:
    """Return the names of the gallery plants, sorted.

    Returns
    -------
    names : list of str
    """
    return sorted(path.stem for path in _GALLERY.glob("*.toml"))


def starter(name: str, like: str | None = None) -> str:
    """Return the commented plant file that ``residua init NAME`` writes.

    Parameters
    ----------
    name : str
        Plant name.
    like : str or None
        Gallery plant that it starts from; None: the cart, with more comments.

    Returns
    -------
    text : str
        TOML.

    Raises
    ------
    PlantError
        The name cannot be a plant's, or the gallery has no such plant.
    """
    check_plant_name(name)
    if like is None:
        text = _STARTER.read_text(encoding="utf-8")
    elif like in gallery_names():
        text = (_GALLERY / f"{like}.toml").read_text(encoding="utf-8")
    else:
        raise PlantError(_no_such_plant(like))
    return re.sub(r'^name( *)= ".*?"', lambda match: f'name{match[1]}= "{name}"', text, count=1, flags=re.M)


def _text(path: Path, name: str) -> str:
    """The file's text with Unix line ends; a byte order mark (Windows editors) is dropped."""
    if path.is_dir():
        raise PlantError(f"{name}: is a folder (expected a plant file). Give the .toml file in it.")
    try:
        return path.read_bytes().decode("utf-8-sig").replace("\r\n", "\n")
    except FileNotFoundError:
        raise PlantError(_no_such_plant(name)) from None
    except UnicodeDecodeError as error:
        raise PlantError(f"{name}: is no UTF-8 text (byte {error.start}). Save it as UTF-8.") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise PlantError(f"{name}: cannot be read ({reason}). Check the path and the permissions.") from None


def _no_such_plant(name: str) -> str:
    gallery = gallery_names()
    near = difflib.get_close_matches(Path(name).stem, gallery, n=1)
    advice = f'Did you mean "{near[0]}"?' if near else "Correct the path, or see: residua list."
    return f"{name}: no such file, and no gallery plant (gallery: {', '.join(gallery)}). {advice}"
