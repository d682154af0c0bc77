"""What a recording for rerun is made of; `rerun_adapter` is the door to it."""
