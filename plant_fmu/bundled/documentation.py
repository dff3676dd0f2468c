"""documentation/index.html of a bundled FMU, and its licence, where FMI has them (3.0.2, 2.5.1)."""

from html import escape
from importlib.metadata import distribution

from nrs_cosim.plant_fmu.bundled.declaration import Declaration, Variable
from nrs_cosim.plant_fmu.bundled.model_description import ORIGIN

_COLUMNS = ("variable", "causality", "shape", "unit", "start", "description")


def documentation(model: Declaration, about: str) -> dict[str, bytes]:
    """The files by their names in the archive; `about` is plain text."""
    heads = "".join(f"<th>{column}</th>" for column in _COLUMNS)
    rows = "".join(map(_row, model.variables))
    page = f"""<!DOCTYPE html>
<html lang="en"><meta charset="utf-8"><title>{model.name}</title>
<h1>{model.name}</h1>
<p>{escape(model.description)}</p>
<p>nrs-cosim {ORIGIN["version"]}, {ORIGIN["license"]} licence (licenses/license.txt)</p>
<pre>{escape(about)}</pre>
<table>
<tr>{heads}</tr>
{rows}</table>
</html>
"""
    licence = distribution("nrs-cosim").read_text("licenses/LICENSE") or ""
    return {
        "documentation/index.html": page.encode(),
        "documentation/licenses/license.txt": licence.encode(),
    }


def _row(v: Variable) -> str:
    shape = " x ".join(dimension.by or str(dimension.start) for dimension in v.dimensions)
    starts = [f"{start:g}" for start in v.starts]
    start = " ".join(starts[:1] if len({*starts}) == 1 else starts)  # one for all that are equal
    cells = (v.name, v.causality, shape, v.unit or "", start, v.description)
    return "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>\n"
