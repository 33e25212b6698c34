"""Benchmarks: `python -m benchmarks` runs them all and writes JSON and a readable table."""
