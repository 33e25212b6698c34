"""Anatomies: the lumen and the wall of the vessels as implicit functions with named openings."""

from typing import TYPE_CHECKING

from lumped.lazy_package import import_on_first_use

if TYPE_CHECKING:
    from jaxfsi.anatomy.anatomy import Anatomy, Centerline, Opening, PointFunction
    from jaxfsi.anatomy.curves.curve import (
        Curve,
        at_arc_length,
        bezier_points,
        curve_through,
        extended,
        rotation_minimising_normals,
    )
    from jaxfsi.anatomy.curves.loft import eccentric_sections, lofted
    from jaxfsi.anatomy.implicit import (
        Foot,
        Tube,
        elliptic_contours,
        polar_contours,
        smooth_minimum,
        surface_points,
        tube,
        tube_foot,
    )
    from jaxfsi.anatomy.operations import (
        IntramuralCourse,
        intramural_course,
        reimplanted,
        stented,
        unroofed,
    )
    from jaxfsi.anatomy.sections import (
        Section,
        centerline_point,
        lumen_outline,
        measured_section,
        plane_axes,
        surface_outline,
        surface_section,
    )
    from jaxfsi.anatomy.sources.aortic_axis import AorticAxis, aortic_gap, wall_coordinates
    from jaxfsi.anatomy.sources.centerline_files import (
        SizedLine,
        longest_line,
        read_centerline,
        read_sized_line,
    )
    from jaxfsi.anatomy.sources.cohort import (
        PUBLISHED,
        Measures,
        Published,
        anatomy_from_measures,
        sample_anatomies,
        sample_measures,
    )
    from jaxfsi.anatomy.sources.ct_course import (
        AortaFit,
        fit_aorta,
        measured_aorta,
        radius_at_ostium,
    )
    from jaxfsi.anatomy.sources.ivus import ivus_anatomy
    from jaxfsi.anatomy.sources.ivus_options import IvusOptions
    from jaxfsi.anatomy.sources.opening_points import opening_points
    from jaxfsi.anatomy.sources.parameters import (
        PARAMETER_RANGES,
        ParameterFault,
        SyntheticParameters,
        adult_anatomy,
        check_parameters,
        coronary_diameter,
        coronary_diameter_sd,
        paediatric_anatomy,
        parameter_faults,
        scaled_anatomy,
    )
    from jaxfsi.anatomy.sources.pullback import Pullback, read_pullback
    from jaxfsi.anatomy.sources.surface import Cut, SurfaceOptions, surface_anatomy
    from jaxfsi.anatomy.sources.synthetic import synthetic_anatomy, synthetic_vessels
    from jaxfsi.anatomy.surfaces.triangles import Triangles, read_triangles
    from jaxfsi.anatomy.vessel_sections import ArterySections, vessel_sections
    from jaxfsi.anatomy.vessels import VesselTube, local_half_width, lumen_distance, lumen_function
    from jaxfsi.anatomy.wall import (
        requested_thickness,
        thickness_from_radius,
        wall_distance,
        wall_function,
    )

__all__ = [
    "PARAMETER_RANGES",
    "PUBLISHED",
    "Anatomy",
    "AortaFit",
    "AorticAxis",
    "ArterySections",
    "Centerline",
    "Curve",
    "Cut",
    "Foot",
    "IntramuralCourse",
    "IvusOptions",
    "Measures",
    "Opening",
    "ParameterFault",
    "PointFunction",
    "Published",
    "Pullback",
    "Section",
    "SizedLine",
    "SurfaceOptions",
    "SyntheticParameters",
    "Triangles",
    "Tube",
    "VesselTube",
    "adult_anatomy",
    "anatomy_from_measures",
    "aortic_gap",
    "at_arc_length",
    "bezier_points",
    "centerline_point",
    "check_parameters",
    "coronary_diameter",
    "coronary_diameter_sd",
    "curve_through",
    "eccentric_sections",
    "elliptic_contours",
    "extended",
    "fit_aorta",
    "intramural_course",
    "ivus_anatomy",
    "local_half_width",
    "lofted",
    "longest_line",
    "lumen_distance",
    "lumen_function",
    "lumen_outline",
    "measured_aorta",
    "measured_section",
    "opening_points",
    "paediatric_anatomy",
    "parameter_faults",
    "plane_axes",
    "polar_contours",
    "radius_at_ostium",
    "read_centerline",
    "read_pullback",
    "read_sized_line",
    "read_triangles",
    "reimplanted",
    "requested_thickness",
    "rotation_minimising_normals",
    "sample_anatomies",
    "sample_measures",
    "scaled_anatomy",
    "smooth_minimum",
    "stented",
    "surface_anatomy",
    "surface_outline",
    "surface_points",
    "surface_section",
    "synthetic_anatomy",
    "synthetic_vessels",
    "thickness_from_radius",
    "tube",
    "tube_foot",
    "unroofed",
    "vessel_sections",
    "wall_coordinates",
    "wall_distance",
    "wall_function",
]

import_on_first_use(__name__)
