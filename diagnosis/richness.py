"""What may be used of a record."""

RICHNESS = ("ffr", "means", "means+flow", "waveforms", "waveforms+flow")
"""From poor to rich; a flow waveform is used with the last."""
