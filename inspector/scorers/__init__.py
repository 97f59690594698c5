"""Processes that score: each holds the inspections that are pinned to it, decodes, scores and records their frames.

Threads were measured and give nothing: much of a step is calls on small arrays under the interpreter's lock (two
threads 1.8 ms a frame, one 1.7, two processes 1.2, on two cores). So scoring is done in processes of its own, and
the one that talks to clients never waits for it. `wire` is what they say to each other, `tape` the recording,
`saved` an inspection as bytes, `inspected` one inspection, `worker` the process, `pool` the side of the service.
"""
