"""How well a model of the tower predicts, beside the simulator restarted from the same input."""
