"""The datasets that come with a clone, which commands take where none is named."""

SELECTION = "jenga-selection@1.1.0"
"""The paper's (J, b, f), one a tower."""
NOISY = "jenga-selection-noisy@1.1.0"
"""Pulls of other towers, with more noise: to train on besides."""
DYNAMICS = "jenga-dynamics@1.0.0"
"""The paper's (J_t, b, a_t, J_t+1), collected by the robot."""
