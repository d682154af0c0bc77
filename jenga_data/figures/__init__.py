"""Figures of the paper from logs."""
