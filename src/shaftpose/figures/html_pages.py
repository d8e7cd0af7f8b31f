"""HTML pages as one file without scripts, from a Jinja template of a package."""

from base64 import b64encode
from importlib import resources
from pathlib import Path

from jinja2 import Environment, StrictUndefined, Template

from shaftpose.core.errors import InputError


def html_template(package: str, name: str) -> Template:
    """A template whose values are escaped, with the filter `embedded` for the paths of pictures."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["embedded"] = data_uri
    return environment.from_string(resources.files(package).joinpath(name).read_text("utf-8"))


def data_uri(picture: Path) -> str:
    """A PNG or JPEG file as an address. Raises InputError if it cannot be read."""
    try:
        content = picture.read_bytes()
    except OSError as error:
        raise InputError(f"{picture}: the figure cannot be read: draw it first") from error
    kind = "png" if picture.suffix == ".png" else "jpeg"
    return f"data:image/{kind};base64,{b64encode(content).decode('ascii')}"
