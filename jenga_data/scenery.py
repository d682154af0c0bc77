"""What stands still around the tower, in the world: turntable, column and table. The truth for simulator and viewers.

The turntable's top is at z = 0, where the tower stands.
"""

TURNTABLE_RADIUS = 0.085
"""Of the disc that the tower stands on [m]; a tower's corners reach 0.053 m from its axis."""
TURNTABLE_HEIGHT = 0.01
"""How thick the disc is [m]."""
COLUMN_RADIUS = 0.03
"""Of what carries the disc, from the table up to its lower side [m]."""
TABLE_TOP = -0.08
"""Height of the table's top [m]: so low that a hand reaches the lowest levels."""
TABLE_SIZE = (1.2, 1.4, 0.02)
"""Of the table's plate along x, y, z [m]."""
TABLE_CENTRE = (0.0, 0.0, TABLE_TOP - TABLE_SIZE[2] / 2)
"""Where the middle of the table's plate is [m]."""
COLUMN_HEIGHT = -TURNTABLE_HEIGHT - TABLE_TOP
"""From the table's top to the disc's lower side [m]."""
