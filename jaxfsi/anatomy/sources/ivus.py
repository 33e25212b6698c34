"""The anatomy of a patient from an ultrasound pullback and the centre lines of a CT.

The measured contours are lofted (`loft`), each turned to the aortic wall (`pullback`), along a path
that follows CT (`ct_course`) and keeps the measured tissue between the two lumens
(`septum_course`). The aorta follows its own centre line and radii where CT gives them, else it is a
straight tube of given radius; the stem of the normal coronary (`normal_branch`) is there where CT
gives its line.

Upstream of the last frame, the ostium, its contour is carried on into the aortic lumen at the
take-off angle. The angle is not in these data: 40° lies in the upper half of the published range
(22.9° ± 11.6°, 81 adults) and keeps the wedge of tissue at the ostium thick enough for elements.
Caution: the ultrasound catheter is 1 mm thick, so no lumen narrower than that can be read.
"""

import contextlib
import os
from collections.abc import Iterator

import numpy as np

from jaxfsi.anatomy.anatomy import OVERRUN, Anatomy
from jaxfsi.anatomy.sources.centerline_files import SizedLine, read_centerline, read_sized_line
from jaxfsi.anatomy.sources.ct_course import AortaFit, fit_aorta, measured_aorta
from jaxfsi.anatomy.sources.ivus_assembly import assembled
from jaxfsi.anatomy.sources.ivus_coronary import coronary_vessel, outlet_radius
from jaxfsi.anatomy.sources.ivus_options import IvusOptions
from jaxfsi.anatomy.sources.normal_branch import NormalBranch, check_apart, normal_branch
from jaxfsi.anatomy.sources.pullback import Pullback, read_pullback
from jaxfsi.anatomy.sources.septum_course import coronary_course
from jaxfsi.anatomy.vessels import VesselTube

_AORTA_RADII = (0.3, 3.0)  # newborn to aneurysm [cm]


def ivus_anatomy(
    contours: str | os.PathLike[str],
    centerline: str | os.PathLike[str],
    *,
    frame_table: str | os.PathLike[str] | None = None,
    reference: str | os.PathLike[str] | None = None,
    state: str = "",
    aorta_radius: float = 1.4,
    aorta_centerline: str | os.PathLike[str] | None = None,
    normal_centerline: str | os.PathLike[str] | None = None,
    septum: float | None = None,
    external: str | os.PathLike[str] | None = None,
    options: IvusOptions | None = None,
) -> Anatomy:
    """Lumen and wall of a patient with an anomalous coronary, in one measured state.

    Args:
        contours: pullback, see `read_pullback`.
        centerline: CT centre line of the anomalous coronary, see `read_centerline`.
        frame_table: order of the frames and measured tissue, see `read_pullback`.
        reference: point on the aortic side, see `read_pullback`.
        state: name of the measured state, kept with the anatomy.
        aorta_radius: radius of a straight aorta [cm], by default that of an adult; plays no part
            beside a centre line of the aorta. A case file has to state one of the two.
        aorta_centerline: CT centre line of the aorta with radii, see `read_sized_line`.
        normal_centerline: CT centre line of the normal coronary with radii, likewise; needs that of
            the aorta. None: there is no such artery.
        septum: tissue between the two lumens [cm], instead of the measured one; needed where the
            frame table holds none.
        external: contours of the external elastic membrane of the same pullback; the wall of the
            coronary then has the measured thickness, not one that follows the radius.
        options: what the measurements do not say.

    Returns:
        The anatomy in aortic coordinates (z along the aorta at the ostium, downstream; z = 0
        there), with openings ``aorta_inlet``, ``aorta_outlet``, ``anomalous_outlet`` and, with a
        normal coronary, ``normal_outlet``. Its ``meta`` holds
        the frames: ``s_frames``, ``area_frames``, ``septum_s``, ``septum``; s is arc length on
        ``centerlines["anomalous"]``, whose first point is the ostium frame.

    Raises:
        ValueError: a file cannot be read, or the data do not fit together; says what to change.
    """
    options = IvusOptions() if options is None else options
    pullback = read_pullback(
        contours, frame_table=frame_table, reference=reference, external=external
    )
    with _about(contours if frame_table is None else frame_table):
        pullback = _with_septum(pullback, septum)
    fit = _fitted_aorta(pullback, centerline, aorta_radius, aorta_centerline, options)
    t_aorta = float(options.thickness(fit.aorta.radius_at(np.zeros(1)))[0])
    course = coronary_course(
        pullback,
        fit.course,
        fit.aorta,
        take_off_angle_deg=options.take_off_angle_deg,
        extension=options.distal_extension,
        clearance=t_aorta + outlet_radius(pullback, options),
        overrun=OVERRUN,
    )
    coronary = coronary_vessel(pullback, course, options)
    normal = None
    if normal_centerline is not None:
        line = read_sized_line(normal_centerline)
        with _about(normal_centerline):
            normal = _normal(fit, line, coronary, aorta_centerline, options)
    with contextlib.nullcontext() if aorta_centerline is None else _about(aorta_centerline):
        return assembled(pullback, fit, course, (coronary, normal), options, state)


def _fitted_aorta(
    pullback: Pullback,
    centerline: str | os.PathLike[str],
    radius: float,
    own: str | os.PathLike[str] | None,
    options: IvusOptions,
) -> AortaFit:
    """The aorta and the coronary's course beside it: from its own centre line, else straight."""
    low, high = _AORTA_RADII
    offset = float(np.nanmean(pullback.septum) + np.ptp(pullback.sections[0, :, 0]) / 2.0)
    if own is None and not low <= radius <= high:
        raise ValueError(
            f"an aortic radius of {radius:g} cm is not within {low:g}..{high:g} cm. Give it in cm."
        )
    line = read_centerline(centerline)
    if own is None:
        with _about(centerline):
            return fit_aorta(line, radius, offset=offset, ostium_end=options.ostium_end)
    sized = read_sized_line(own)
    with _about(own):
        fit = measured_aorta(line, sized, offset=offset, ostium_end=options.ostium_end)
        found = fit.aorta.radius
        if not low <= found.min() <= found.max() <= high:
            raise ValueError(
                f"the radius of the aorta is {found.min():.2g}..{found.max():.2g} cm, expected"
                f" within {low:g}..{high:g} cm. Give the line of the aorta, in mm."
            )
    return fit


def _normal(
    fit: AortaFit,
    line: SizedLine,
    coronary: VesselTube,
    aorta_centerline: str | os.PathLike[str] | None,
    options: IvusOptions,
) -> NormalBranch:
    """The stem of the normal coronary, clear of the anomalous one."""
    if aorta_centerline is None:
        raise ValueError(
            "the normal coronary needs the aorta from which it springs. Give the centre line of"
            " the aorta too."
        )
    branch = normal_branch(
        fit,
        line,
        length=options.normal_length,
        fillet=options.fillet,
        thickness=options.thickness,
    )
    check_apart(coronary, branch.vessel)
    return branch


@contextlib.contextmanager
def _about(file: str | os.PathLike[str]) -> Iterator[None]:
    """Name the file that a refusal is about."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from error


def _with_septum(pullback: Pullback, septum: float | None) -> Pullback:
    """The pullback with a given septum on its first centimetre, or the measured one."""
    if septum is not None:
        if not 0.0 < septum <= 1.0:
            raise ValueError(f"a septum of {septum:g} cm is not between 0 and 1 cm. Give it in cm.")
        beside = pullback.s <= max(1.0, float(pullback.s[1]))
        return pullback._replace(septum=np.where(beside, septum, np.nan))
    if not np.any(np.isfinite(pullback.septum)):
        raise ValueError(
            "no tissue thickness between aorta and coronary is known. Give a frame table with a"
            " measurement_1 column, or the septum [cm]."
        )
    return pullback
