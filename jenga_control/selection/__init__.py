"""Which block: ranking, and everything that judges who ranks."""

from jenga_control.selection.rank import Selector, rank

__all__ = ["Selector", "rank"]
