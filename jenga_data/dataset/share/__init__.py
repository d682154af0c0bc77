"""Datasets to and from other places: folders, S3, the Hugging Face hub, and whatever else fsspec knows."""
