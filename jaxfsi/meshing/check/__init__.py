"""Quality, topology and fidelity of a mesh."""
