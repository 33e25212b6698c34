"""Triangle surfaces: reading, distance, edits, flat ends, crossings."""
