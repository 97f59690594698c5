"""The command line: `inspector record | learn | replay | evaluate | push | serve | ...`; errors are single lines.

Exit codes: 0 did its job, 1 an inspection could not be made, 2 wrong usage, 3 `--fail-on-ng`, 130 interrupted.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from inspector.cli.batch import batch
from inspector.cli.demo import demo
from inspector.cli.detectability import detectability
from inspector.cli.evaluate import evaluate
from inspector.cli.learn import learn
from inspector.cli.locate import locate
from inspector.cli.push import push
from inspector.cli.record import record
from inspector.cli.replay import replay
from inspector.cli.serve import serve
from inspector.cli.track import track
from inspector.cli.workspace import workspace
from models.errors import InspectionError

app = typer.Typer(add_completion=False, no_args_is_help=True, rich_markup_mode=None, pretty_exceptions_enable=False)
for command in (record, learn, replay, batch, evaluate, detectability, demo, serve, push, locate, track):
    app.command()(command)
app.add_typer(workspace, name="workspace")


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(version("sweep-inspector"))
        raise typer.Exit


@app.callback()
def inspector(
    version: Annotated[bool, typer.Option("--version", callback=_version, help="Print the version.")] = False,
) -> None:
    """Show it one good part; it watches every part after.

    Example: inspector demo
    """


def main() -> None:
    """The entry point."""
    for library in ("OPENBLAS", "OMP"):
        # Read by NumPy when it is loaded: hidden threads make many streams slower, and may change last bits.
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    sys.exit(run(sys.argv[1:]))


def run(arguments: Sequence[str]) -> int:
    """Run one command; errors become one line on stderr and an exit code."""
    try:
        return app(arguments, prog_name="inspector", standalone_mode=False) or 0
    except typer.TyperException as error:
        print(_usage(error), file=sys.stderr)
        return error.exit_code
    except InspectionError as error:
        print(f"inspector: {error}", file=sys.stderr)
    except OSError as error:
        name = f"{error.filename}: " if error.filename else ""
        print(f"inspector: {name}{error.strerror or error}", file=sys.stderr)
    return 1


def _usage(error: typer.TyperException) -> str:
    """What is wrong in a line; the help, where nothing was asked."""
    said = error.format_message()
    return said if said.startswith("Usage:") else f"inspector: {said.replace(chr(10), ' ')} (see --help)"
