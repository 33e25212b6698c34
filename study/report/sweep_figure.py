"""The figure of a sweep over α."""

from matplotlib import rc_context
from matplotlib.figure import Figure

from study.report.style import COLOURS, INK, STYLE, svg
from study.store.stored_document import Document


def sweep_figure(document: Document) -> str:
    """Ratio and mean flow over alpha."""
    rows = document["rows"]
    alphas = [row["alpha"] for row in rows]
    name = "rest_ratio" if document["condition"] == "rest" else "ffr"
    with rc_context(STYLE):
        figure = Figure(figsize=(8.4, 3.2), layout="constrained")
        left, right = figure.subplots(1, 2)
        left.plot(alphas, [row[name] for row in rows], color=COLOURS[0])
        left.set_ylabel("resting ratio" if name == "rest_ratio" else "FFR")
        right.plot(alphas, [row["mean_flow_ml_per_min"] for row in rows], color=COLOURS[1])
        right.set_ylabel("mean coronary flow [mL/min]")
        measured = document["measured"]
        if measured is not None:
            left.axhline(measured, color=INK, linewidth=1.0, linestyle="--")
            left.text(0.01, measured, f"measured {measured:g}", va="bottom", fontsize=8.5,
                      transform=left.get_yaxis_transform())  # fmt: skip
        for axes in (left, right):
            axes.set_xscale("log")
            axes.set_xlabel("alpha [-]")
        rule = "" if document["rule"] is None else f', rule "{document["rule"]}"'
        figure.suptitle(
            f"{document['patient']}: {document['condition']}, {document['law']} law{rule}",
            fontsize=10,
        )
        return svg(figure, "sweep")
