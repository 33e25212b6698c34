"""Captions of the pictures of a 3D run."""

PICTURES = {
    "pressure": "Pressure less that of the aortic inlet, in a plane along the anomalous artery;"
    " wall grey. The wall is shown where it is at that instant.",
    "speed": "Speed of the blood in the same plane.",
    "wall": "The wall from outside, coloured by its displacement (where it is rigid: the lumen,"
    " coloured by wall shear stress).",
    "lumen": "The lumen around the anomalous artery from three sides: change of the ratio per area"
    " and shift outwards; blue: wider there raises it, red: lowers it.",
}
"""What the pictures show, by name."""
