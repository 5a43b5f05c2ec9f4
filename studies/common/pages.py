"""HTML pages: one look for all, figures inside, nothing fetched from elsewhere."""

import base64
import json
import re
from pathlib import Path
from typing import Any

import jinja2

from glassgait.models.robots.robot import DEFAULT_ROBOT, Robot
from glassgait.models.task.drawing import ink_on
from glassgait.studies.common.tables import format_cell

SHARED_TEMPLATES = Path(__file__).parent / "templates"


def page_template(folder: Path, name: str) -> jinja2.Template:
    """Loads a template of a study; it may extend the shared `page.html`.

    Args:
        folder: Folder of the study's own templates.
        name: File name.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([folder, SHARED_TEMPLATES]),
        autoescape=jinja2.select_autoescape(["html"]),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["cell"] = format_cell
    environment.filters["minus"] = with_minus
    environment.globals["chip"] = chip_style
    return environment.get_template(name)


def gait_title(gait: str, robot: Robot) -> str:
    """Returns what a page calls a gait: whose it is too, where that is not the default robot."""
    whose = "" if robot.name == DEFAULT_ROBOT else f" of the {robot.name.capitalize()}"
    return f"{gait.capitalize()}{whose}"


def with_minus(text: str) -> str:
    """Writes the minus signs of numbers as such."""
    return re.sub(r"-(?=[0-9])", "−", text)


def chip_style(color: str) -> str:
    """Returns the style of a label on a colour, with the ink that can be read on it."""
    return f"background: {color}; color: {ink_on(color)}"


def embedded(value: Any) -> str:
    """Writes a value as JSON that may stand inside a script element."""
    return json.dumps(value).replace("<", "\\u003c")


def inline_image(path: Path) -> str:
    """Encodes a picture as a URL that holds all of it."""
    kind = {".png": "image/png", ".svg": "image/svg+xml", ".gif": "image/gif"}[path.suffix]
    return f"data:{kind};base64,{base64.b64encode(path.read_bytes()).decode()}"
