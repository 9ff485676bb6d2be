"""Which shapes touch where: the pairs of shapes that are near each other, and the points of each pair."""
