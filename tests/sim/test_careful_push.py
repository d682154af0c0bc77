"""The push that watches: as long as it only looks on it is the plain one, and it turns back where a layer moves."""

import numpy as np
import pytest
from robot_stage import CONFIG, Workplace, put, workplace

from jenga_data.collect.careful_push import GIVE_UP, TURN_BACK, CarefulSkills
from jenga_data.collect.skills import Skills

STEP = 0.0008


class Counting(CarefulSkills):
    """Counts strokes, and lets somebody move a block behind the push's back."""

    strokes = 0
    meddle = 0.0
    pushing = False

    def _strike(self) -> None:
        self.strokes += 1
        super()._strike()

    def push_forward(self, path) -> None:
        self.pushing = True
        super().push_forward(path)
        self.pushing = False

    def frame(self, turning=None) -> None:
        super().frame(turning)
        if self.meddle and self.pushing:
            block = int(self._world.layout.grid[3, 1])
            where = self._world.pose[block, :3]
            put(self._world, f"block_{block}", where + self.meddle * np.eye(3)[0])


class Patient(Counting):
    """Looks on, whatever moves."""

    turn_back = np.inf
    give_up = 0.0


def pushed(skills: type[Skills], meddle: float = 0.0) -> Workplace:
    place = workplace(CONFIG, make_skills=skills)
    place.skills.take_stick()
    place.recording.phase("push")
    if isinstance(place.skills, Counting):
        place.skills.meddle = meddle
    place.skills.push()
    return place


def way(place: Workplace) -> np.ndarray:
    return np.asarray(place.log.frames[-1].pose[:, :3] - place.log.frames[0].pose[:, :3])


@pytest.mark.usefixtures("unchecked_shapes")
def test_looking_on_changes_nothing_of_a_push():
    """Also of one that meets too much force, which then ends without a stroke if that is what is asked for."""
    plain, careful = pushed(Skills), pushed(Patient)
    assert isinstance(careful.skills, Counting)
    assert careful.skills.strokes == 0
    np.testing.assert_array_equal(way(plain), way(careful))


class Resigned(Counting):
    """Gives up as soon as it has turned back."""

    give_up = 0.0


def out_at_end(place: Workplace) -> float:
    return float(way(place)[place.recording.target, 0])


@pytest.mark.usefixtures("unchecked_shapes")
def test_it_turns_back_when_another_block_moves_and_goes_on_in_a_stroke():
    place = pushed(Counting, meddle=STEP)
    assert isinstance(place.skills, Counting)
    assert place.skills.strokes == 1
    assert 0.017 <= out_at_end(place) < 0.03
    hand = np.array([(sample.time_ns, sample.pose[0]) for sample in place.log.samples])
    speed = np.diff(hand[:, 1]) / np.diff(hand[:, 0]) * 1e9
    assert 0.3 < speed.max() < 0.6  # m/s: at least six times the slow push


@pytest.mark.usefixtures("unchecked_shapes")
def test_it_gives_up_where_the_layer_has_moved_too_far():
    assert TURN_BACK < GIVE_UP
    place = pushed(Resigned, meddle=STEP)
    assert isinstance(place.skills, Counting)
    assert place.skills.strokes == 0
    assert out_at_end(place) < 0.01
