"""Simulate, log, convert, share and replay Jenga rollouts. Never imports torch."""
