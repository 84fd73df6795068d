"""One HTML file that needs nothing else: style, script, figures and plotly.js inside.

A content security policy in the page forbids it to load anything, so "works offline" is kept by the
browser, not by good will.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from importlib import resources

from jinja2 import Environment, PackageLoader, StrictUndefined

from gcs_sysid.figures.data import Figure
from gcs_sysid.report import labels, numbers, palette, strips
from gcs_sysid.report.plotly_figure import legend, specification


def render(template: str, figures: Iterable[Figure], context: Mapping[str, object]) -> str:
    """Fills a template of this package.

    Args:
        template: its file name.
        figures: every figure that the template places, by `Figure.name`.
        context: the template's own names.
    """
    specifications = {figure.name: specification(figure) for figure in figures}
    return (
        _environment()
        .get_template(template)
        .render(
            **context,
            payload=_script_json({"figures": specifications, "palettes": _palettes()}),
            plotly_js=_plotly_js(),
            light=palette.LIGHT,
            dark=palette.DARK,
            heights={name: item["layout"]["height"] for name, item in specifications.items()},
        )
    )


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("gcs_sysid.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "coefficient": labels.coefficient,
        "regressor": labels.regressor,
        "typeset": labels.typeset,
        "number": numbers.number,
        "plus_minus": numbers.plus_minus,
        "duration": numbers.duration,
        "laid_out": strips.laid_out,
        "legend": legend,
    }
    return environment


def _palettes() -> dict[str, Mapping[str, str]]:
    return {"light": palette.LIGHT, "dark": palette.DARK}


def _script_json(value: object) -> str:
    """JSON that cannot close the script element around it, whatever strings it holds."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _plotly_js() -> str:
    return (resources.files("plotly") / "package_data" / "plotly.min.js").read_text("utf-8")
