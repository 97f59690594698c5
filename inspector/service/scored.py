"""Scores of the frames of inspections that have ended, as long as they are kept."""

from __future__ import annotations

from inspector.service.errors import ScoresGone
from inspector.stores.base import AbstractStore
from inspector.stores.records import StoredInspection


def kept_scores(store: AbstractStore, stored: StoredInspection) -> bytes | None:
    """As they were stored; None for one without a result, which never had any. Blocks. Raises ScoresGone."""
    scores = store.scores(stored.inspection_id)
    if scores is None:
        # Asked once more: they may have been removed since `stored` was read.
        since = store.inspection(stored.inspection_id).scores_removed_ns
        if since is not None:
            raise ScoresGone(stored.inspection_id, since)
    return scores
