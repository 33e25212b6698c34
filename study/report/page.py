"""The report of a run: one HTML page that stands alone, made from the result's document."""

import importlib.resources
from collections.abc import Iterator, Mapping
from typing import Any

import jinja2
from markupsafe import Markup

from study.report.body_words import body_words
from study.report.figures import figures
from study.report.headline import chance_at_or_below, percent
from study.report.mesh_figures import mesh_figures
from study.report.number_formats import signed, significant, span, with_sd
from study.report.parameter_names import NAMES
from study.report.picture_captions import PICTURES
from study.report.ratio_limits import SOURCES, limit_rows, measured_words
from study.report.simulation_figures import simulation_figures
from study.report.time_spent import time_parts
from study.report.uncertainty_figures import uncertainty_figure
from study.report.uncertainty_words import rules_words, uncertainty_rows, uncertainty_words
from study.report.wall_figures import MODELS, wall_figure
from study.run.limits import AREA_BOUND, FFR_THRESHOLD
from study.store.document_rows import gap_rows, laws, ratio_rows

Document = Mapping[str, Any]


Pictures = Mapping[str, Mapping[str, str]]


def html_report(document: Document, pictures: Pictures | None = None) -> str:
    """The report of a run or of meshes as HTML, its figures inside.

    Args:
        document: what `case_document` or `mesh_document` made, fresh or read back.
        pictures: addresses of pictures by state and name, see `study.report.mesh_results.embedded`.
    """
    if document["kind"] == "mesh":
        return rendered("mesh.html", d=document, meshes=list(mesh_rows(document, pictures or {})))
    return rendered(
        "report.html",
        d=document,
        meshes=list(mesh_rows(document.get("mesh") or {}, pictures or {})),
        fig=safe({**figures(document), "uncertainty": uncertainty_figure(document)}),
        laws=laws(document),
        rows=list(ratio_rows(document)),
        gaps=list(gap_rows(document)),
        windkessels=list(windkessel_rows(document)),
        top=top_sensitivities(document),
        uncertainty=uncertainty_rows(document),
        uncertainty_words=uncertainty_words(document),
        rules_words=rules_words(document),
        limits=limit_rows(document),
        limit_sources=SOURCES,
        measured_words=measured_words(document),
        called=NAMES,
    )


def simulation_report(
    document: Document, pictures: Mapping[str, str], vessel: str | None = None
) -> str:
    """The report of a 3D run as HTML, its figures inside.

    Args:
        document: what `simulation_document` made, fresh or read back.
        pictures: addresses of pictures by name.
        vessel: name of the page of the vessel beside it; None: there is none.
    """
    return rendered(
        "simulation.html",
        d=document,
        fig=safe(simulation_figures(document)),
        picture=pictures,
        captions=PICTURES,
        vessel=vessel,
    )


def wall_report(document: Document) -> str:
    """The report of a calibrated wall as HTML, its figure inside.

    Args:
        document: what `wall_document` made, fresh or read back.
    """
    drawn = safe({"wall": wall_figure(document)})
    return rendered("wall.html", d=document, fig=drawn, models=MODELS)


def rendered(name: str, **values: Any) -> str:
    """A page from its template."""
    folder = importlib.resources.files("study.report") / "templates"
    environment = jinja2.Environment(
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        loader=jinja2.FunctionLoader(lambda part: (folder / part).read_text("utf-8")),
    )
    environment.filters |= {
        "sig": significant,
        "span": span,
        "signed": signed,
        "with_sd": with_sd,
        "chance": lambda value, sd: percent(chance_at_or_below(value, sd)),
    }
    environment.globals |= {
        "threshold": FFR_THRESHOLD,
        "area_bound": AREA_BOUND,
        "body_words": body_words,
        "time_parts": time_parts,
    }
    return environment.get_template(name).render(**values)


def safe(drawn: Mapping[str, str]) -> dict[str, Markup]:
    """Figures that a template may insert as they are."""
    return {name: Markup(text) for name, text in drawn.items()}


def mesh_rows(part: Document, pictures: Pictures) -> Iterator[dict[str, Any]]:
    """The mesh of each state with its figures and pictures."""
    for state, entry in part.get("states", {}).items():
        yield {
            **entry,
            "fig": safe(mesh_figures(entry)),
            "picture": pictures.get(state, {}),
            "seconds": sum(entry["wall_time_s"].values()),
        }


def windkessel_rows(document: Document) -> Iterator[dict[str, Any]]:
    """Aortic Windkessel of each condition that has one."""
    for name, entry in document["conditions"].items():
        if entry["aortic_windkessel"] is not None:
            yield {"condition": name, **entry["aortic_windkessel"]}


def top_sensitivities(document: Document) -> list[dict[str, Any]]:
    """What moves FFR in each stress condition, in numbers.

    `per_measured` is the change of FFR for +0.01 in the measured resting ratio; `items` are the
    three strongest of the other parameters with the change of FFR for +10 %.
    """
    found = []
    for entry in document["sensitivities"]:
        own = (entry["law"], entry["rule"]) == (document["law"], document["rule"])
        if not own or entry["condition"] == "rest":
            continue
        run = next(r for r in document["runs"] if r.items() >= _setting(entry).items())
        slopes = dict(entry["recalibrated"])
        target = document["calibrations"][entry["law"]]["target"]
        per_measured = 0.01 * slopes.pop("rest_ratio") * run["ffr"] / target
        strongest = sorted(slopes.items(), key=lambda pair: -abs(pair[1]))[:3]
        found.append(
            {
                "condition": entry["condition"],
                "per_measured": per_measured,
                "items": [
                    (NAMES.get(name, name), run["ffr"] * (1.1**slope - 1.0))
                    for name, slope in strongest
                ],
            }
        )
    return found


def _setting(entry: Mapping[str, Any]) -> dict[str, Any]:
    return {key: entry[key] for key in ("condition", "law", "rule", "boundary")}
