"""A procedurally drawn part under a moving camera: docs, tests and the demo all use it."""

from inspector.cameras.simulated.camera import SimulatedCamera
from inspector.cameras.simulated.truth import DefectTruth, FrameTruth

__all__ = ["DefectTruth", "FrameTruth", "SimulatedCamera"]
