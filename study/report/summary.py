"""A document as text for a terminal."""

from collections.abc import Iterator, Mapping
from typing import Any

from study.report.body_words import BED_NOTICE, body_lines
from study.report.number_formats import signed
from study.report.ratio_limits import measured_words
from study.report.uncertainty_words import causes_words, help_words, rules_words, uncertainty_words
from study.store.document_rows import gap_rows, laws, ratio_rows

Document = Mapping[str, Any]


def summary(document: Document) -> str:
    """The document of any command in a few lines."""
    lines = {
        "run": _run,
        "calibrate": _calibration,
        "wall": _wall,
        "sweep": _sweep,
        "mesh": _mesh,
        "simulate": _simulation,
        "study": _study,
        "cohort": _cohort,
        "what-if": _what_if,
        "diagnose": _diagnosis,
        "plan": _plan,
        "import": _imported,
    }[document["kind"]]
    return "\n".join(lines(document)) + "\n"


def _diagnosis(document: Document) -> Iterator[str]:
    yield f"{document['id']}"
    yield ""
    yield document["sentence"]
    yield from (f"- {step}" for step in document.get("to_do", []))
    yield ""
    for name, p in list(document["probabilities"].items())[:6]:
        yield f"  {name.replace('_', ' '):<44}{p:>7.3f}"
    for effect in document["effects"]:
        if effect["id"] in document["named"]:
            yield f"  {effect['sentence']}; {effect['place']}"
    for held in document["gap"]["held_out"]:
        rms = held["P_distal_rms_mmHg"]
        if rms is not None:
            yield (
                f"held out, {held['condition']}: distal pressure off by {rms['before']:.2f} mmHg "
                f"before, {rms['after']:.2f} after, {rms['noise_floor']:.2f} from noise"
            )
    if document.get("lumen"):
        yield f"lumen: {document['lumen']['sentence']}"
    yield from _next(document)
    for remark in document["remarks"]:
        yield f"! {remark}"


def _plan(document: Document) -> Iterator[str]:
    yield f"{document['id']}"
    yield from _next(document)
    if document.get("uncertainty"):
        yield uncertainty_words(document)
    for entry in document.get("uncertainty", []):
        yield from help_words(entry)
    for name, row in document["sensors"].items():
        yield f"{name}: {len(row['isolable'])} effects could be told, {', '.join(row['isolable'])}"


def _imported(document: Document) -> Iterator[str]:
    yield f"{document['id']}"
    yield f"{'condition':<16}{'beats':>9}{'period s':>10}{'P aorta':>14}{'distal':>8}{'ratio':>8}"
    for c in document["conditions"]:
        beats = f"{c['beats_used']}/{c['beats_found']}"
        pressures = f"{c['P_systolic_mmHg']:.0f}/{c['P_diastolic_mmHg']:.0f}"
        pressures += f" ({c['mean_P_aorta_mmHg']:.1f})"
        yield (
            f"{c['name'][:15]:<16}{beats:>9}{c['period_s']:>10.3f}{pressures:>14}"
            f"{c['mean_P_distal_mmHg']:>8.1f}{c['ratio']:>8.3f}"
        )
    for c in document["conditions"]:
        yield ""
        yield from (f"{c['name']}: {remark}" for remark in c["remarks"])
    if document["drift"]:
        yield ""
        yield f"! {document['drift']['sentence']}"


def _next(document: Document) -> Iterator[str]:
    for option in document["next_measurements"]:
        first, second = (name.replace("_", " ") for name in option["separates"])
        gain = option["expected_log_bayes_factor"]
        yield f"measure next: {option['sensor']} ({first} against {second}, ln B {gain:.1f})"


def _run(document: Document) -> Iterator[str]:
    yield f"{document['patient']}"
    yield ""
    yield from body_lines(document)
    yield from _intervals(document)
    yield document["verdict"]
    yield from measured_words(document)
    yield from _small_print(document)
    yield ""
    columns = [f"{law[:4]}. {outlet}" for law in laws(document) for outlet in ("nominal", "calib.")]
    yield f"{'condition':<14}{'rule':<10}{'measured':>9}" + "".join(f"{c:>15}" for c in columns)
    for row in ratio_rows(document):
        measured = "-" if row["measured"] is None else f"{row['measured']:.3f}"
        cells = "".join(f"{run['ratio']:>15.3f}" for _, run in row["cells"])
        yield f"{row['condition'][:13]:<14}{row['rule'] or '-':<10}{measured:>9}{cells}"
    yield ""
    yield from _alphas(document)
    gaps = [run for run in gap_rows(document) if run["condition"] != "rest"]
    if gaps:
        yield ""
        yield "predicted less measured:"
    for run in gaps:
        outlet = "nominal" if run["boundary"] == "fixed" else run["boundary"]
        yield (
            f"  {run['condition']}, {run['law']} law, rule {run['rule']}, {outlet} outlet: "
            f"{signed(run['gap']['difference'], 3)} ({signed(run['gap']['z'], 1)} sd)"
        )
    for note in document["notes"]:
        if note["level"] == "warning":
            yield ""
            yield f"! {note['text']}"
    mesh = document.get("mesh")
    if mesh:
        yield ""
        if "failure" in mesh:
            yield f"! no mesh was made: {mesh['failure']}"
        else:
            yield from _mesh({"patient": document["patient"], **mesh})


def _intervals(document: Document) -> Iterator[str]:
    """FFR with intervals and their causes, where they were asked for."""
    if not document.get("uncertainty"):
        return
    yield uncertainty_words(document)
    for entry in document["uncertainty"]:
        yield f"  {entry['condition']}: {causes_words(entry)}"
        yield from (f"  {line}" for line in help_words(entry))
    yield ""
    yield rules_words(document)


def _small_print(document: Document) -> Iterator[str]:
    """What the uncertainty holds, and what R0 does."""
    if document.get("headline", {}).get("readings"):
        yield document["headline"]["not_included"]
    if document.get("resistance_words"):
        yield document["resistance_words"]


def _calibration(document: Document) -> Iterator[str]:
    yield f"{document['patient']}"
    yield from _alphas(document)


def _alphas(document: Document) -> Iterator[str]:
    for law, fit in document["calibrations"].items():
        if "failure" in fit:
            yield f"{law} law: not calibrated: {fit['failure']}"
            continue
        low, high = fit["alpha_95"]
        checks = [("bisection", fit["bisection"]), ("closed form", fit["closed_form"])]
        checked = "".join(f"; {name} {x:.4g}" for name, x in checks if x is not None)
        if document.get("models", {}).get(law, {}).get("R0_assumed"):
            checked += "; belongs to the assumed R0"
        yield (
            f"{law} law: alpha = {fit['alpha']:.4g} (95 %: {low:.3g} to {high:.3g}) for a resting "
            f"ratio of {fit['target']:g}{checked}"
        )


def _wall(document: Document) -> Iterator[str]:
    yield f"{document['patient']}: wall from {len(document['states'])} states"
    for row in document["stiffness"]:
        numbers = f"{row['value']:.3g} (95 %: {row['low']:.3g} to {row['high']:.3g})"
        yield f"  {row['name']:<12}{numbers} {row['unit']}; case {row['start']:.3g}"
    yield from (f"- {line}" for line in document["determined"])
    for note in document["notes"]:
        yield f"{'!' if note['level'] == 'warning' else '-'} {note['text']}"


def _sweep(document: Document) -> Iterator[str]:
    name = "rest_ratio" if document["condition"] == "rest" else "ffr"
    rule = "" if document["rule"] is None else f', rule "{document["rule"]}"'
    yield f"{document['patient']}: {document['condition']}, {document['law']} law{rule}"
    yield f"{'alpha':>12}{name:>12}{'ifr':>10}{'flow mL/min':>14}"
    rows = document["rows"]
    step = max(1, -(-len(rows) // 20))
    shown = rows[::step] if rows[-1] in rows[::step] else [*rows[::step], rows[-1]]
    for row in shown:
        yield (
            f"{row['alpha']:>12.5g}{row[name]:>12.4f}{row['ifr']:>10.4f}"
            f"{row['mean_flow_ml_per_min']:>14.2f}"
        )


def _mesh(document: Document) -> Iterator[str]:
    yield f"{document['patient']}: {document['preset']} mesh"
    yield (
        f"{'state':<20}{'blood':>9}{'wall':>9}{'angle deg':>11}{'area error':>12}"
        f"{'septum ratio':>15}{'Euler':>12}{'time s':>8}"
    )
    for name, entry in document["states"].items():
        quality, septum = entry["quality"], entry["fidelity"] and entry["fidelity"]["septum_ratio"]
        tets = quality["n_tets"]
        angle = min(m["min_dihedral_deg"]["minimum"] for m in quality["measures"].values())
        sections = entry["sections"]
        error = f"{100 * sections[0]['largest_error']:.2f} %" if sections else "-"
        ratio = f"{septum['p1']:.3f}-{septum['p99']:.3f}" if septum else "-"
        euler = ",".join(str(number) for number in entry["topology"]["euler"].values())
        yield (
            f"{name[:19]:<20}{tets.get('fluid', 0):>9}{tets.get('solid', 0):>9}{angle:>11.2f}"
            f"{error:>12}{ratio:>15}{euler:>12}{sum(entry['wall_time_s'].values()):>8.1f}"
        )
    for note in document["notes"]:
        yield ""
        yield f"{'! ' if note['level'] == 'warning' else ''}{note['text']}"


def _simulation(document: Document) -> Iterator[str]:
    solver = document["solver"]
    wall = "rigid wall" if document["rigid"] else "moving wall"
    yield f"{document['patient']}: {document['condition']}, {wall}, alpha = {document['alpha']:.6g}"
    yield from body_lines(document)
    yield (
        f"{solver['steps_done']} of {solver['steps_planned']} steps of {solver['dt_s']:.4g} s,"
        f" {len(document['events'])} repeated"
    )
    yield f"{'cycle':<10}{'opening':<20}{'mean P mmHg':>13}{'mean Q mL/min':>15}{'ratio':>9}"
    for cycle in document["cycles"]:
        label = f"{cycle['cycle']}" + ("" if cycle["complete"] else " (part)")
        ratio = "" if cycle["ratio"] is None else f"{cycle['ratio']:.4f}"
        for name, port in cycle["ports"].items():
            yield (
                f"{label:<10}{name[:19]:<20}{port['mean_P_mmHg']:>13.2f}"
                f"{port['mean_Q_ml_per_min']:>15.1f}{ratio:>9}"
            )
            label = ratio = ""
    for note in document["notes"]:
        yield ""
        yield f"{'! ' if note['level'] == 'warning' else ''}{note['text']}"


def _study(document: Document) -> Iterator[str]:
    yield f"{document['patient']}"
    yield ""
    yield from body_lines(document)
    yield from _intervals(document)
    yield document["verdict"]
    yield from measured_words(document)
    yield from _small_print(document)
    yield ""
    head = f"{'condition':<14}{'rule':<10}{'measured':>9}{'linear 0D':>11}{'curve 0D':>10}"
    yield f"{head}{'3D':>9}{'sd':>9}"
    for row in document["rows"]:
        cells = (row["measured"], row["linear_0d"], row["curve_0d"], row["fsi"], row.get("fsi_sd"))
        text = ["-" if value is None else f"{value:.4f}" for value in cells]
        yield (
            f"{row['condition'][:13]:<14}{row['rule'] or '-':<10}"
            f"{text[0]:>9}{text[1]:>11}{text[2]:>10}{text[3]:>9}{text[4]:>9}"
        )
    yield ""
    for entry in document["calibrations"]:
        yield (
            f"alpha = {entry['alpha']:<10.5g} {entry['origin']}: resting Pd/Pa in 3D"
            f" {entry['rest_ratio']:.4f} ({signed(entry['error'], 4)})"
        )
    for note in document["notes"]:
        if note["level"] == "warning" or BED_NOTICE in note["text"]:
            yield ""
            yield f"{'! ' if note['level'] == 'warning' else ''}{note['text']}"


def _cohort(document: Document) -> Iterator[str]:
    done = [p for p in document["patients"] if p["status"] == 0]
    yield f"{len(done)} of {len(document['patients'])} cases, mode {document['mode']}"
    yield ""
    yield f"{'condition':<14}{'rule':<10}{'outlet':<12}{'n':>4}{'bias':>9}{'sd':>8}{'RMSE':>8}"
    for group in document["groups"]:
        sd = "-" if group["sd"] is None else f"{group['sd']:.4f}"
        yield (
            f"{group['condition'][:13]:<14}{group['rule'] or '-':<10}{group['boundary']:<12}"
            f"{group['n']:>4}{signed(group['bias'], 4):>9}{sd:>8}{group['rmse']:>8.4f}"
        )
    measured = [e for e in document.get("intervals", []) if e["measured"] is not None]
    if measured:
        inside = sum(e["low"] <= e["measured"] <= e["high"] for e in measured)
        yield ""
        yield f"measured FFR within its 90 % interval: {inside} of {len(measured)}"
    for patient in document["patients"]:
        if patient["status"] != 0:
            yield f"! {patient['name']}: {patient['reason']}"


def _what_if(document: Document) -> Iterator[str]:
    yield f"{document['patient']}, {document['mode'].upper()}"
    yield document["verdict"]
    yield ""
    yield f"{'condition':<14}{'rule':<10}{'measured':>9}{'before':>9}{'after':>9}{'change':>9}"
    for row in document["ratios"]:
        measured = "-" if row["measured"] is None else f"{row['measured']:.3f}"
        after = row["after"]
        cells = ("-", "-") if after is None else (f"{after:.3f}", signed(after - row["before"], 3))
        yield (
            f"{row['condition'][:13]:<14}{row['rule'] or '-':<10}{measured:>9}"
            f"{row['before']:>9.3f}{cells[0]:>9}{cells[1]:>9}"
        )
    yield ""
    for name in ("before", "after"):
        side = document[name]
        K = "" if side["K"] is None else f", K {side['K']:.4g} dyn s2/cm8"
        yield (
            f"{name}: {side['length_mm']:.1f} mm long, least area {min(side['area_mm2']):.2f} mm2,"
            f" least minor axis {min(side['minor_axis_mm']):.2f} mm,"
            f" R0 {side['R0']:.4g} dyn s/cm5{K}"
        )
