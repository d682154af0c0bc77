"""Versioned Parquet datasets: converted from logs, described by a manifest, read and verified."""
