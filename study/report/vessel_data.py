"""What the page of a vessel holds: shapes, and what happens on them over a cycle; in mm and mmHg.

It lies as JSON beside the result, so that the page can be made again, alone or beside others.
"""

import dataclasses

from study.report.packed_array import PackedArray

VESSEL_FORMAT = "jaxfsi-vessel-1"


@dataclasses.dataclass(frozen=True)
class VesselSections:
    """Planes across the anomalous artery.

    Attributes:
        s_mm: distance from the ostium.
        area_image_mm2: area in the reference shape.
        minor_image_mm: minor axis there.
        ring_sizes: number of points of each ring.
        ring_low: first end of the edge on which each point lies, of all rings.
        ring_high: its second end.
        ring_share: place between them, 0 at the first.
    """

    s_mm: list[float]
    area_image_mm2: list[float]
    minor_image_mm: list[float]
    ring_sizes: list[int]
    ring_low: PackedArray
    ring_high: PackedArray
    ring_share: PackedArray


@dataclasses.dataclass(frozen=True)
class LumenShape:
    """The lumen in the reference shape.

    Attributes:
        points_mm: nodes.
        triangles: nodes of each triangle.
        node_s_mm: distance of each node from the ostium along the anomalous artery; below 0 where
            it belongs to another vessel.
        sections: see `VesselSections`; None where the artery has no axis.
        focus_mm: point that the first view looks at.
        toward: direction from it to the eye.
        up: what is up.
        half_mm: half of the height of the first view.
    """

    points_mm: PackedArray
    triangles: PackedArray
    node_s_mm: PackedArray
    sections: VesselSections | None
    focus_mm: list[float]
    toward: list[float]
    up: list[float]
    half_mm: float


@dataclasses.dataclass(frozen=True)
class SectionCourse:
    """The planes over a cycle.

    Attributes:
        ratio: mean pressure over the mean aortic pressure [-].
        P_mmHg: pressure, by frame and plane.
        area_mm2: area, by frame and plane; 0 where no lumen is found.
        minor_mm: minor axis, by the same.
    """

    ratio: list[float]
    P_mmHg: PackedArray
    area_mm2: PackedArray
    minor_mm: PackedArray


@dataclasses.dataclass(frozen=True)
class VesselView:
    """A run: what happens on a shape over a cycle.

    Attributes:
        id: of the run.
        shape: number of its shape.
        condition: name of the condition.
        rule: stress rule; None at rest, and where there is no choice.
        outlet: the scale of its resistances, in words.
        wall: the wall, in words.
        ratio_name: `ffr`, or `rest_ratio`.
        ratio: the ratio of the run, distal to aortic mean pressure [-]; None: no whole cycle.
        measured: measured ratio; None where there is none.
        whole: whether the frames hold a whole cycle.
        period_s: length of a cycle.
        P_aorta_mean_mmHg: mean aortic pressure that ratios are taken to.
        P_distal_mean_mmHg: mean pressure at the distal outlet.
        distal_s_mm: distance of that outlet from the ostium; None: no axis.
        t_s: times of the frames from the start of the cycle.
        P_aorta_mmHg: aortic pressure in each frame.
        P_distal_mmHg: pressure at the distal outlet in each frame.
        node_ratio: mean pressure over the mean aortic pressure, at each node [-].
        least_ratio: the least of them.
        node_P_mmHg: pressure, by frame and node.
        moved_mm: displacement, by frame and node; None where nothing moves.
        sections: see `SectionCourse`; None where there are none.
        wider_per_mm3: change of the ratio per shift of the lumen outwards and area, at each node;
            None: not computed.
        picture: PNG file of the lumen as the address of a picture.
    """

    id: str
    shape: int
    condition: str
    rule: str | None
    outlet: str
    wall: str
    ratio_name: str
    ratio: float | None
    measured: float | None
    whole: bool
    period_s: float
    P_aorta_mean_mmHg: float
    P_distal_mean_mmHg: float
    distal_s_mm: float | None
    t_s: list[float]
    P_aorta_mmHg: list[float]
    P_distal_mmHg: list[float]
    node_ratio: PackedArray
    least_ratio: float
    node_P_mmHg: PackedArray
    moved_mm: PackedArray | None
    sections: SectionCourse | None
    wider_per_mm3: PackedArray | None
    picture: str


@dataclasses.dataclass(frozen=True)
class VesselData:
    """All of a page.

    Attributes:
        format: `VESSEL_FORMAT`.
        patient: name of the patient.
        limit: ratio that is marked [-].
        shapes: see `LumenShape`.
        views: see `VesselView`; the first to be shown comes last.
    """

    format: str
    patient: str
    limit: float
    shapes: list[LumenShape]
    views: list[VesselView]


def joined(parts: list[VesselData]) -> VesselData:
    """Pages of several results as one; equal shapes are kept once.

    Args:
        parts: the result that is shown first, then those beside it; of views that a reader could
            not tell apart the first is kept.
    """
    shapes: list[LumenShape] = []
    views: dict[tuple[str | None, ...], VesselView] = {}
    for part in parts:
        for view in reversed(part.views):
            told = (view.condition, view.rule, view.outlet, view.wall)
            if told not in views:
                shape = part.shapes[view.shape]
                if shape not in shapes:
                    shapes.append(shape)
                views[told] = dataclasses.replace(view, shape=shapes.index(shape))
    return dataclasses.replace(parts[0], shapes=shapes, views=list(views.values())[::-1])
