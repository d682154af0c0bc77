import numpy as np

from jenga_control.tables import extraction_tables
from jenga_data.statistics import Proportion


def test_extraction_runs_stand_side_by_side_with_their_causes():
    success = Proportion.of(np.array([True, True, False])).as_dict()
    run = {"dynamics": "learned", "switches": {"selector": False}, "success": success, "control_hz": 31.0}
    text = extraction_tables(
        [
            {**run, "way": "naive", "objective": "naive", "causes": {"slipped": 2}},
            {
                **run,
                "way": "full-best",
                "objective": "full",
                "causes": {},
                "switches": {"selector": True, "push": True},
            },
        ]
    )
    assert "| naive | naive | learned | none | 0.67" in text
    assert "| full-best | full | learned | push, selector | 0.67" in text
    assert "| Cause of failure | naive | full-best |" in text
    assert "| slipped | 2 | 0 |" in text
