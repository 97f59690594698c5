"""Workspace: which object one picture shows, and where it is, over one to four task parameters.

`learn_workspace` makes a `Workspace` from pictures whose object and parameters are known; `Workspace.locate` finds
both for a new picture. Positioning is one call, tracking is one per frame.
"""

from models.workspace.grid import LabelledPicture, Parameter
from models.workspace.learning import learn_workspace
from models.workspace.located import Located, Rival
from models.workspace.workspace import Workspace

__all__ = ["LabelledPicture", "Located", "Parameter", "Rival", "Workspace", "learn_workspace"]
