"""Batches: thousands of recordings through the one scoring path, several at a time; what is done is not done again."""

from inspector.batch.running import Batch, Counted, run_batch
from inspector.batch.tasks import By, Outcome, Task, find_recordings

__all__ = ["Batch", "By", "Counted", "Outcome", "Task", "find_recordings", "run_batch"]
