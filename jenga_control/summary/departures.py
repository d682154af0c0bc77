"""Where this project departs from the paper, and why. Numbers come from the configurations, so that they stay true."""

from dataclasses import dataclass

import numpy as np

from jenga_control.planning.cost import PAPER_COST
from jenga_control.planning.mppi import PRESETS
from jenga_data.collect.config import ExtractionConfig, SelectionConfig
from jenga_data.outcome import THRESHOLDS
from jenga_models.config import DYNAMICS_PRESETS, SELECTION_PRESETS


@dataclass(frozen=True)
class Departure:
    """One place: what the paper does or says, what is done here, and the reason."""

    what: str
    paper: str
    here: str
    why: str


def departures() -> list[Departure]:
    """All of them, in the order in which data flow; what is a choice because the paper is silent says so."""
    return [*_tower(), *_rollouts(), *_graphs(), *_training(), *_control()]


def _tower() -> list[Departure]:
    selection, extraction = SelectionConfig(), ExtractionConfig()
    physics, spawn = selection.physics, selection.spawn
    return [
        Departure("simulator", "Isaac Lab", "MuJoCo 4", "runs anywhere without a GPU; the same seed, the same bytes"),
        Departure(
            "block sizes and masses",
            "from an own set; no numbers given",
            "from the published statistics of 54 real blocks (`jenga_data/blocks.py`)",
            "the paper's measurements are not public",
        ),
        Departure(
            "friction",
            "tuned by hand until 47 % of the blocks are movable; no value given",
            f"{physics.friction:.2f}, tuned to the same 47 % (`jenga calibrate movable`)",
            "the paper's number depends on its simulator",
        ),
        Departure(
            "contacts",
            "not described",
            f"soft on touch (impedance {physics.touch_impedance:g} to {physics.impedance:g} within "
            f"{1e6 * physics.impedance_width:.0f} µm), strongly damped (ratio {physics.damping_ratio:g})",
            "stock contacts let blocks sink by 0.5 mm, three times the spread of heights that makes a block tight",
        ),
        Departure(
            "towers of round r",
            "spawned at random between rounds 1 and 15",
            f"grown by r - 1 legal moves of blocks that carry at most {spawn.load_limit:g} N, and then seen to stand",
            "towers that are shuffled at random fall by themselves from round 8 on",
        ),
        Departure(
            "turning the table",
            "the turntable turns the standing tower",
            "the tower sleeps and turns rigidly with the table; the friction that this takes is computed",
            "soft contacts shift by about 1 mm in a turn, which wood does not",
        ),
        Departure(
            "gripper",
            "THK SEED and Picsel actuator with own fingers",
            f"two flat fingers of {extraction.gripper.grip_force:g} N on slides, friction "
            f"{extraction.gripper.finger_friction:g}",
            "its geometry is not public",
        ),
    ]


def _rollouts() -> list[Departure]:
    selection, extraction = SelectionConfig(), ExtractionConfig()
    kp, ki = selection.gains
    return [
        Departure(
            "pull of the selection data",
            "a velocity along -x is applied to the block, with noise along y and z",
            f"a velocity servo (PI: {kp:g} N s/m, {ki:g} N/m) of {selection.speed:g} m/s that pulls with at most "
            f"{selection.force_limit:g} N and gives up after {selection.patience:g} s without "
            f"{1e3 * selection.least_progress:g} mm of progress",
            "a velocity without a limit of force tears every block out: nothing would ever be stuck",
        ),
        Departure(
            "pull of the dynamics data",
            "random extraction interactions; no distribution given",
            f"mean displacement a step log-uniform from {1e3 * extraction.slowest:g} to {1e3 * extraction.fastest:g} "
            f"mm, {100 * extraction.speed_noise:g} % noise, up to {1e3 * extraction.side:g} mm sideways; speeds "
            "change no faster than the arm can",
            "the paper is silent; slow and fast pulls end differently",
        ),
        Departure(
            "push",
            "roughly 2 cm",
            f"{1e3 * extraction.robot.push_distance:g} mm, stopped at {extraction.robot.push_force:g} N; a push that "
            "fails has a named cause",
            "a harder push drags layers along",
        ),
        Departure(
            "world frame",
            "not given",
            "poses and actions after the table has turned, so that every pull is along -x",
            "one frame for all blocks of a tower and for all towers",
        ),
        Departure(
            "failure",
            "stuck or collapsed; no thresholds given",
            f"any other block dropped by {1e3 * THRESHOLDS.drop:g} mm is a collapse; extracted is clear of the "
            f"tower, which stands {THRESHOLDS.standing:g} s later; all else is stuck; dragged (beyond "
            f"{1e3 * THRESHOLDS.drag:g} mm) is reported beside it",
            "labels must be computable from poses alone",
        ),
        Departure(
            "splits",
            "400 of 2,000 rollouts held out",
            "4:1 by tower, validation towers apart; test towers are never trained or tuned on",
            "several pulls of one tower are alike: a split by rows would leak",
        ),
    ]


def _graphs() -> list[Departure]:
    best = SELECTION_PRESETS["best"]
    return [
        Departure(
            "edges",
            "a block to the blocks right below that it touches",
            "the same, by footprint and gap from poses and sizes alone, without the simulator's contacts",
            "the graph can be made on a prediction or a real tower, where nobody knows the contacts",
        ),
        Departure(
            "features of the selector",
            "G_s: sizes, mass, target flag",
            f"preset paper: G_s; preset best: {best.graph}",
            "in a full tower every block touches all three below: G_s alone cannot tell a middle block from a side one",
        ),
        Departure(
            "features' scale",
            "not given",
            "standardised",
            "raw sizes in metres differ in the fourth decimal and teach a network nothing",
        ),
        Departure(
            "quaternions",
            "7-D poses, next minus present",
            "the same, with the sign of the next quaternion chosen nearest to the present one",
            "q and -q are one rotation: a difference of nearly 2 could stand for no motion",
        ),
    ]


def _training() -> list[Departure]:
    selector, dynamics = SELECTION_PRESETS["best"], DYNAMICS_PRESETS["best"]
    plain = SELECTION_PRESETS["paper"]
    return [
        Departure(
            "selector, preset paper",
            "GCN of 6 layers, Adam, 1e-3, batch 100, 150 epochs; width and readout not given",
            f"the same; {plain.width} numbers a node, {plain.readout} over all blocks",
            "the paper is silent on both",
        ),
        Departure(
            "selector, preset best",
            "–",
            f"{selector.members} networks that sweep down and up the levels, {selector.layers} times in all, read out "
            f"at the {selector.readout}; they learn how a pull ended and moved the blocks beside its label",
            "load goes down a tower and support comes up; a label alone is one bit a pull",
        ),
        Departure(
            "simulator, preset best",
            "4 layers of a GNS, mean squared error",
            f"width {dynamics.width}; told velocities and the hand's lag; looks at the tower once a decision and "
            "answers all plans with a small network a block; its loss is the length of each error",
            "without velocities not even the simulator knows what comes; composing graphs was the paper's bottleneck",
        ),
    ]


def _control() -> list[Departure]:
    paper, best = PRESETS["paper"], PRESETS["best"]
    spread, wide = (", ".join(f"{1e3 * axis:g}" for axis in np.broadcast_to(p.sigma, 3)) for p in (paper, best))
    return [
        Departure(
            "temperature and first plan of MPPI",
            "not given",
            f"{best.temperature:g}, normalised by the spread of the costs; a pull of "
            f"{-1e3 * paper.initial_action[0]:g} mm a step, preset best: {-1e3 * best.initial_action[0]:g} mm",
            "the objective is linear in a_x: without a start it has no optimum but the limit",
        ),
        Departure(
            "spread of sampled plans",
            "sigma 1 mm",
            f"preset paper: {spread} mm in x, y, z; preset best: {wide}",
            "fast pulls disturb least; by 1 mm a decision a block is out before the search has found them",
        ),
        Departure(
            "limits of sampled plans",
            f"{1e2 * paper.search_high[0]:g} cm on every axis, 0.1 cm executed in y and z",
            "preset paper: the same; preset best: sampled within what can be executed and the arm's acceleration",
            "plans should be judged by what will be done",
        ),
        Departure(
            "norm in O_d",
            "over V, whose entries are 7-D poses; units not said",
            f"preset: {PAPER_COST.norm} in metres, with the paper's weights; the 7-D norm is an option",
            "metres and quaternions cannot be added without a scale",
        ),
        Departure(
            "graph within the horizon",
            "composed anew for every sample and step",
            "that of the tower at the decision, for all samples",
            "composing graphs limits the paper's rate; a few centimetres change little of what rests on what",
        ),
    ]
