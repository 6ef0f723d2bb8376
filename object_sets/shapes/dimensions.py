"""Sizes shared by the authored shapes, in metres."""

NOMINAL = (
    0.0675  # all three extents of most shapes: the middle of the training range 4.5-9 cm (paper, section 4)
)
CHAMFER = 0.002  # on the edges of the printed objects
