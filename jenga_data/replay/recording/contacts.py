"""Forces as arrows, and who touches whom as a graph."""

import numpy as np
import rerun as rr

from jenga_data import palette
from jenga_data.replay.contact_points import contact_points, graph_nodes
from jenga_data.replay.measures import metres_per_newton
from jenga_data.replay.recording.recorder import Recorder

NODE = (70.0, -40.0)
"""A step to the right and a level up in the contact graph."""
_FAINTEST = 0.02
"""Contacts weaker than this are not drawn [N]."""


def log_contacts(to: Recorder) -> None:
    """Forces as arrows, and who touches whom as a graph that is laid out like the tower."""
    episode, target = to.episode, to.episode.header.target
    contacts, at, frames = contact_points(episode), episode.time_ns, len(episode.time_ns)
    strong = np.linalg.norm(contacts.force, axis=1) > _FAINTEST
    on_target = (contacts.first == target) | (contacts.second == target)
    arrows = rr.Arrows3D.columns(
        origins=contacts.point[strong].astype(np.float32),
        vectors=(contacts.force[strong] * metres_per_newton(contacts.force)).astype(np.float32),
        colors=palette.rgba8(np.where(on_target[strong, None], palette.VERMILLION, palette.FORCE)),
    )
    to.static("/world/contacts", rr.Arrows3D.from_fields(radii=[0.0014]))
    to.columns("/world/contacts", at, arrows.partition(np.bincount(contacts.frame[strong], minlength=frames)))

    nodes = graph_nodes(episode, contacts)
    colours = np.tile(palette.UNKNOWN, (len(nodes.name), 1))
    colours[: len(episode.header.blocks)] = palette.wood(episode.header.layout.level)
    colours[target] = palette.SKY_BLUE  # the target's own blue is too dark for letters on black
    rgba, where = palette.rgba8(colours), nodes.position * NODE
    to.static("/graph", rr.GraphNodes(nodes.name, positions=where, colors=rgba, labels=nodes.name))
    ends = np.array(nodes.name)[nodes.row[np.stack([contacts.first, contacts.second], axis=1)]]
    to.columns("/graph", at, rr.GraphEdges.columns(edges=ends).partition(contacts.counts(frames)))
