"""Pulling in closed loop: the ways to pull, and their comparison on the same towers."""
