"""Blind benchmark of `diagnosis`: records whose cause is sealed until the diagnoses are written.

`python -m benchmarks.blind make DIR`, `diagnose DIR`, `score DIR`. The generator imports nothing
from `diagnosis` and shares neither its integrator nor its equations.
`python -m benchmarks.blind.in_3d DIR --study RESULTS` makes records from 3D runs instead (tier 3).
"""
