"""Batches: thousands of recordings through the one scoring path, several at a time; what is done is not done again."""

from inspector.batch.running import Batch, Counted, run_batch
from inspector.batch.tables import TableKind, refuse_missing
from inspector.batch.tasks import By, Outcome, Task, find_recordings

__all__ = ["Batch", "By", "Counted", "Outcome", "TableKind", "Task", "find_recordings", "refuse_missing", "run_batch"]
