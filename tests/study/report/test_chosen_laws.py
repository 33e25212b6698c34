"""A page names laws that a case chooses, and is silent about the usual ones."""

import dataclasses

from jaxfsi.meshing import tube
from study import BloodParameters, TissueParameters, WallParameters, demo_case_path, read_case
from study.report.chosen_laws import chosen_laws, wall_without_columns


def test_usual_laws_need_no_words_and_chosen_ones_are_named_with_their_numbers():
    case = read_case(demo_case_path())
    assert list(chosen_laws(case)) == []
    wall = WallParameters(damping=300.0, volumetric_penalty=1e6, tissue=TissueParameters(2e5, 40.0))
    case = dataclasses.replace(case, wall=wall, blood=BloodParameters(law="carreau_yasuda"))
    blood, damping, penalty, tissue = chosen_laws(case)
    assert "from 0.56 to 0.0345 poise" in blood
    assert "300 poise" in damping
    assert "1e+06 dyn/cm²" in penalty
    assert "200000 dyn/cm³ and 40 dyn·s/cm³" in tissue
    close = dataclasses.replace(case, wall=WallParameters(minimum_gap=0.01))
    assert list(chosen_laws(close))[1:] == [
        "sides of the lumen repel each other below a gap of 0.1 mm"
    ]
    soft = dataclasses.replace(case, wall=WallParameters(material="neo_hookean"))
    assert list(chosen_laws(soft))[1:] == ["the elastic law of the wall is neo_hookean"]
    fibres = WallParameters(material="holzapfel_gasser_ogden", k1=1e6, dispersion=0.1)
    (words,) = list(chosen_laws(dataclasses.replace(case, wall=fibres)))[1:]
    assert "collagen fibres" in words
    assert "at 35° to the circumference, with k1 1e+06 dyn/cm², k2 1 and dispersion 0.1" in words
    assert list(chosen_laws(case, rigid=True)) == [blood]


def test_a_wall_that_is_to_bend_without_columns_says_what_that_costs():
    case = read_case(demo_case_path())
    whole, columns = (
        tube(radius=1.0, length=2.0, thickness=0.2, n_around=8, n_axial=2, n_layers=1, columns=c)
        for c in (False, True)
    )
    (words,) = wall_without_columns(case, whole)
    assert "no columns of wedges" in words
    linear = dataclasses.replace(case, wall=WallParameters(element="linear"))
    assert not list(wall_without_columns(linear, whole))
    assert not list(wall_without_columns(case, columns))
