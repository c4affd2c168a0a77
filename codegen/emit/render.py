"""The one jinja environment, and where the templates are."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined, TemplateError

from ..errors import EmitError


def template_root() -> Path:
    """Return the folder of the templates: inside the installed package, or beside it in a checkout.

    Raises
    ------
    EmitError
        Neither is there: the installation is damaged.
    """
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "_templates", package.parent / "templates"):
        if (folder / "observer.c.jinja").is_file():
            return folder
    raise EmitError(f"templates: not found in {package / '_templates'} nor in {package.parent / 'templates'}. "
                    "Install residua again.")


@cache
def environment() -> Environment:
    """Return the environment: an undefined name is an error, and line ends are as in the template."""
    return Environment(loader=FileSystemLoader(template_root()), undefined=StrictUndefined, trim_blocks=True,
                       lstrip_blocks=True, keep_trailing_newline=True, autoescape=False)


def render(template: str, **views) -> str:
    """Print a template.

    Parameters
    ----------
    template : str
        Path below the template root.
    **views
        Frozen dataclasses, under the names that the template uses.

    Returns
    -------
    text : str

    Raises
    ------
    EmitError
        The template does not exist, is wrong, or asks for what the view does not have.
    """
    try:
        return environment().get_template(template).render(**views)
    except TemplateError as error:
        raise EmitError(f"templates/{template}: {type(error).__name__}: {error}. Correct the template.") from error
