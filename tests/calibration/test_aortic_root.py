import jax
import jax.numpy as jnp
import pytest

from calibration import aortic_root_diameter


@pytest.mark.parametrize("area", [0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8])
def test_sinuses_agree_with_magnetic_resonance(area):
    # Kaiser et al. 2008, JCMR 10:56: 53 children of 2 to 20 years, 0.57 + 19.37 √BSA mm
    other = 0.057 + 1.937 * area**0.5
    # two methods in two cohorts: both give a spread of about a tenth between children
    assert float(aortic_root_diameter("sinus", area)) == pytest.approx(other, rel=0.13)


def test_root_is_narrowest_at_the_annulus_and_widest_at_the_sinuses():
    areas = jnp.linspace(0.5, 2.2, 18)
    annulus, sinus, junction = (
        aortic_root_diameter(level, areas) for level in ("annulus", "sinus", "junction")
    )
    assert jnp.all((annulus < junction) & (junction < sinus))
    assert jnp.all(jnp.diff(sinus) >= 0.0)


def test_derivative_by_the_body():
    def sinus(area):
        return aortic_root_diameter("sinus", area)

    h = 1e-5
    slope = (sinus(1.2 + h) - sinus(1.2 - h)) / (2.0 * h)
    assert float(jax.grad(sinus)(1.2)) == pytest.approx(float(slope), rel=1e-8)  # h² and 1e-16/h
