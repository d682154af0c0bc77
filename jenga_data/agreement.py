"""How well the graph's edges, from poses and sizes alone, agree with the contacts that the simulator found."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from jenga_data.episode import Episode
from jenga_data.graph import support_edges


@dataclass(frozen=True)
class Agreement:
    """Pairs of blocks, one upon the other: found by both, by the geometry alone, by the simulator alone."""

    both: int
    edge_only: int
    contact_only: int

    @property
    def recall(self) -> float:
        """Share of the simulator's contacts that are edges."""
        return self.both / max(1, self.both + self.contact_only)

    @property
    def precision(self) -> float:
        """Share of the edges that touch in the simulator; the rest belong to loose blocks."""
        return self.both / max(1, self.both + self.edge_only)

    def as_dict(self) -> dict[str, float | int]:
        return {
            "recall": self.recall,
            "precision": self.precision,
            "both": self.both,
            "edge_only": self.edge_only,
            "contact_only": self.contact_only,
        }


def edge_agreement(episodes: Iterable[Episode], frame: int = 0) -> Agreement:
    """Compare both at one frame of each episode. Contacts between blocks of one level are no edges and do not count."""
    both = edge_only = contact_only = 0
    for episode in episodes:
        level = episode.header.layout.level
        edges = set(map(tuple, support_edges(episode.pose[frame], episode.header.blocks.size).T.tolist()))
        contacts = episode.contacts[frame]
        between = np.flatnonzero((contacts.first >= 0) & (contacts.second >= 0))
        touching = set()
        for a, b in zip(contacts.first[between].tolist(), contacts.second[between].tolist(), strict=True):
            if level[a] != level[b]:
                touching.add((a, b) if level[a] > level[b] else (b, a))
        both += len(edges & touching)
        edge_only += len(edges - touching)
        contact_only += len(touching - edges)
    return Agreement(both, edge_only, contact_only)
