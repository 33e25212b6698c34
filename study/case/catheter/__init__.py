"""Exports of catheter consoles: minutes of pressure, many beats, made into records and conditions.

`table` reads text, `dicom_channels` and `dicom_table` a DICOM file, `columns` says which column is
what, `trace` cleans the `samples`, `beats` finds beats and leaves out those of no use, `beat_means`
averages them, `drift` compares conditions, `record_text` writes a record and conditions of a case
file.
"""
