"""How fast the parts are, measured beside what they have to keep up with."""
