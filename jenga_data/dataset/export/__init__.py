"""Datasets in the forms that other tools look for: Croissant, a Hugging Face dataset, a LeRobot dataset."""
