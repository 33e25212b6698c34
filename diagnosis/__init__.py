"""The gap between simulation and measurement."""
