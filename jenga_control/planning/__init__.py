"""MPPI: plans, what they cost, and what predicts the tower under them."""
