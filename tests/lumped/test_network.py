import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lumped import (
    RC,
    RCR,
    Constant,
    FlowSource,
    PressureSource,
    Resistance,
    Sinusoid,
    Surrogate,
    Vessel,
    condition_from_clinic,
    connect,
    field,
    is_index_one,
    state_space,
)
from lumped.network import jacobian
from lumped.verification import BLOCKS, PERIOD, VESSELS

P = PressureSource(Constant(1e5))
Q = FlowSource(Constant(2.0))
REST = condition_from_clinic(110, 65, 0.8)
BED = RCR(100.0, 1e-3, 1e3)


@pytest.mark.parametrize(
    ("elements", "message"),
    [
        ({}, "needs elements"),
        ({"a": (1.0, "n")}, "Give a tuple"),
        ({"a": (P, "n", "m")}, r"1 port\(s\) but 2 node"),
        ({"a": (P, "n"), "b": (Vessel(1.0), "n")}, r"2 port\(s\) but 1 node"),
        ({"a": (P, "n"), "b": (Resistance(1.0), "m")}, "Only one port meets at node 'n'"),
    ],
)
def test_impossible_networks_are_refused(elements, message):
    with pytest.raises(ValueError, match=message):
        connect(elements)


def test_unknown_names_are_refused_with_the_known_ones():
    network = connect({"a": (P, "n"), "b": (Resistance(1.0), "n")})
    for look in (network.state_index, network.flow_index):
        with pytest.raises(KeyError, match="a, b"):
            look("c", "x") if look == network.state_index else look("c")
    with pytest.raises(KeyError, match="No node 'm'"):
        network.pressure_index("m")


def test_index_is_detected():
    indirect = {"p": (P, "n"), "v": (Vessel(60.0, C=1e-5), "n", "m"), "b": (BED, "m")}
    assert is_index_one(connect(indirect))
    assert is_index_one(Surrogate(R0=1e-3).network(REST))
    assert not is_index_one(connect({"p": (P, "n"), "b": (RC(1.0, 1.0), "n")}))
    assert not is_index_one(
        connect({"q": (Q, "n"), "a": (RC(1.0, 1.0), "n"), "b": (RC(2.0, 1.0), "n")})
    )
    assert not is_index_one(
        connect({"q": (Q, "n"), "v": (Vessel(1.0, L=1.0), "n", "m"), "b": (BED, "m")})
    )
    assert not is_index_one(Surrogate(R0=0.0).network(REST))
    assert is_index_one(Surrogate(R0=0.0, K=1e4).network(REST))


def test_vector_field_refuses_index_two_and_states_refuse_losses():
    clash = connect({"p": (P, "n"), "b": (RC(1.0, 1.0), "n")})
    with pytest.raises(ValueError, match=r"two compliances.*Elements: p, b"):
        field(clash)
    with pytest.raises(ValueError, match="not an ordinary"):
        state_space(clash)
    with pytest.raises(ValueError, match="quadratic loss"):
        state_space(Surrogate(R0=1.0, K=1.0).network(REST))


def branching():
    return connect(
        {
            "heart": (FlowSource(Sinusoid(80.0, 30.0, PERIOD)), "root"),
            "trunk": (VESSELS["stenosis"], "root", "fork"),
            "left": (VESSELS["RC"], "fork", "a"),
            "right": (Vessel(R_viscous=30.0), "fork", "b"),
            "bed a": (BLOCKS["rcr"], "a"),
            "bed b": (BLOCKS["coronary"], "b"),
        }
    )


def test_residual_conserves_volume_at_every_node():
    network = branching()
    z = jnp.asarray(np.random.default_rng(0).normal(size=network.n_unknowns))
    balance = network.residual(0.1, z)[-len(network.nodes) :]
    expected = {node: 0.0 for node in network.nodes}
    for name, ports in zip(network.names, network.ports, strict=True):
        for k, node in enumerate(ports):
            expected[node] += float(z[network.flow_index(name, k)])
    np.testing.assert_allclose(balance, list(expected.values()), rtol=1e-14, atol=1e-14)
    # all flows over all nodes: what the source gives is what the states store and the beds drain
    assert network.nodes == ("root", "fork", "a", "b")
    assert network.state_index("bed b", "y_im") == network.n_states - 1


def test_vector_field_is_the_state_space():
    @jax.jit
    def rates(network):
        system = state_space(network)
        x = jnp.array([9e4, 8e4, 5e4])
        t = jnp.asarray(0.21)
        v = system.sources(t[None])[0]
        return field(network)(t, x, None), system.A @ x + system.B @ v

    np.testing.assert_allclose(*rates(Surrogate(R0=5e3).network(REST)), rtol=1e-12)


def test_vector_field_takes_another_network_as_argument():
    one, other = (Surrogate(R0=R0).network(REST) for R0 in (5e3, 7e3))
    x = jnp.array([9e4, 8e4, 5e4])
    replaced = jax.jit(lambda model: field(one)(0.1, x, model))(other)
    own = jax.jit(lambda model: field(model)(0.1, x, None))(other)
    np.testing.assert_allclose(replaced, own, rtol=1e-14)


def test_jacobian_matches_differences():
    network = branching()
    z = jnp.asarray(np.random.default_rng(1).uniform(1.0, 2.0, size=network.n_unknowns))
    J = jacobian(network, 0.1, z)
    f = jax.jit(lambda z: network.residual(0.1, z))
    for k in range(network.n_unknowns):
        h = 1e-4
        column = (f(z.at[k].add(h)) - f(z.at[k].add(-h))) / (2 * h)
        # quadratic at most: central differences are exact up to rounding
        np.testing.assert_allclose(
            J[:, k], column, rtol=1e-6, atol=1e-8 * float(jnp.max(jnp.abs(J)))
        )
