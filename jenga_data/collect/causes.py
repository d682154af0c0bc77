"""What can go wrong on the robot's side of a rollout."""

CAUSES = {
    "unsettled": "the tower did not come to rest before it was to be turned",
    "turn_toppled": "the tower fell while the table turned, or because of it",
    "bumped": "the arm, the hand or the stick touched the tower where it should not have",
    "self_collision": "the arm touched itself, the table or what stands on it",
    "stick_missed": "the hand closed and did not hold the stick",
    "stick_lost": "the stick did not come to lie in its holder again",
    "push_stuck": "the target did not come out far enough before the push became too hard",
    "push_dragged_layer": "the push moved another block by more than 5 mm",
    "push_toppled": "the tower fell during the push",
    "approach_toppled": "the tower fell while the hand came near",
    "grasp_missed": "the fingers closed and nothing was between them",
    "grasp_two_blocks": "the fingers touched another block than the target",
    "slipped": "the target moved in the fingers by more than 5 mm",
    "out_of_reach": "an action or a skill would have taken the hand out of the arm's reach or speed",
    "dropped": "the target fell out of the fingers",
    "out_of_time": "the target was still in the tower after the last action",
}
"""What can go wrong on the robot's side; an episode's cause is the first that did."""


class Failure(Exception):
    """A skill's named failure, one of `CAUSES`, that ends the rollout."""

    def __init__(self, cause: str) -> None:
        super().__init__(f"{cause}: {CAUSES[cause]}")
        self.cause = cause
