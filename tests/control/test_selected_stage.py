"""The classifier picks the target: the safest one of all legal ones, with everything else as it was drawn."""

from types import SimpleNamespace

import numpy as np
from closed_loops import tower

from jenga_control.extraction.evaluate import Switches, switched
from jenga_control.extraction.selected_stage import with_safest_target
from jenga_data.collect.config import Actor
from jenga_data.collect.stage import Stage
from jenga_data.tower import quarter_turns_for


class Prefers:
    def __init__(self, favourite: int) -> None:
        self.favourite = favourite

    def failure_probability(self, state, targets):
        return np.where(np.array(targets) == self.favourite, 0.1, 0.9)


def test_the_safest_legal_target_is_pulled_from_the_face_that_was_drawn():
    state = tower()
    drawn, favourite = state.layout.legal_targets()[0], state.layout.legal_targets()[-1]
    assert drawn != favourite
    for face in (0, 1):
        stage = Stage(state, drawn, quarter_turns_for(state.layout, drawn, face), face, 7)
        chosen = with_safest_target(stage, Prefers(favourite))
        assert (chosen.target, chosen.face, chosen.tries) == (favourite, face, 7)
        assert chosen.turn == quarter_turns_for(state.layout, favourite, face)
        assert chosen.state is state


def test_switches_are_in_the_settings_of_who_acts(monkeypatch, tmp_path):
    card = SimpleNamespace(require=lambda kind: SimpleNamespace(hash="c" * 64))
    monkeypatch.setattr("jenga_models.checkpoint.load", lambda folder: card)
    plain = Actor({"name": "straight", "speed": 0.15})
    assert switched(plain, Switches()) == plain
    pushed, selected = switched(plain, Switches(push_control=True)), switched(plain, Switches(select=tmp_path))
    assert pushed.controller["push_control"]["turn_back"] > 0
    assert selected.controller["select"] == "c" * 64
    assert "push_control" not in plain.controller
