"""The surfaces that bound a mesh."""
