"""Which block: ranking, and everything that judges who ranks.

`from jenga_control.selection import rank` gives what `ranking.py` holds, and loads it then.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jenga_control.selection.ranking import Selector, rank

__all__ = ["Selector", "rank"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from jenga_control.selection import ranking

    return getattr(ranking, name)
