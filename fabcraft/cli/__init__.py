"""The command line: `fabcraft make | check | solid | guidance | subjects | evaluate | printers | bodies | templates |
weights | backends`.

Results go to stdout, progress and errors to stderr; `--json` prints the report alone. Exit codes:
0 printable, 1 made but the report has a failure, 2 usage or unreadable input, 3 something needed is absent,
4 no closed manifold could be made, 70 a defect of fabcraft, 130 interrupted. Nothing heavy is imported before
a command needs it.
"""

import os
import sys
import warnings
from collections.abc import Callable, Sequence

from cyclopts import App, CycloptsError

from fabcraft import __version__
from fabcraft.cli.backends import backends
from fabcraft.cli.catalogue import PLAIN, bodies
from fabcraft.cli.check import check
from fabcraft.cli.console import drop_stdout, say
from fabcraft.cli.evaluate import evaluate
from fabcraft.cli.guidance import guidance
from fabcraft.cli.make import make
from fabcraft.cli.printers import printers
from fabcraft.cli.solid import solid
from fabcraft.cli.subjects import subjects
from fabcraft.cli.templates import templates
from fabcraft.cli.weights import weights
from fabcraft.errors import FabcraftError

DEFECT, INTERRUPTED = 70, 130
_EPILOGUE = """Examples:

  fabcraft make mask --sketch cat.png --body woman -o cat.3mf
  fabcraft make cat.toml
  fabcraft check part.stl --printer prusa-mk4
  fabcraft solid surface.obj --wall 1.6 -o part.3mf

More about a command: fabcraft COMMAND --help

Exit codes: 0 printable; 1 made, but the report has a failure; 2 usage or
unreadable input; 3 something needed is absent; 4 no closed manifold could
be made; 130 interrupted."""

app = App(
    name="fabcraft",
    version=f"fabcraft {__version__}",
    help="From a drawing and a body to a wearable that a printer prints.",
    help_epilogue=_EPILOGUE,
    help_format="plaintext",
    default_parameter=PLAIN,
    result_action="return_value",
    suppress_keyboard_interrupt=False,  # it has a sentence and a code of its own here
)
_COMMANDS: tuple[Callable[..., int], ...] = (make, check, solid, guidance, subjects, evaluate)
for position, function in enumerate(_COMMANDS):
    app.command(function, sort_key=position, help_epilogue="")
for group in (bodies, printers, templates, weights, backends):
    app.command(group)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command line (`sys.argv` when None) and return its exit code, also for a user's mistake."""
    # Idle OpenMP threads that spin take the processor from those that work; read when torch is imported.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # a terminal without ² must not end an hour of work
    words = list(sys.argv[1:] if arguments is None else arguments)
    with warnings.catch_warnings():
        if not os.environ.get("FABCRAFT_TRACEBACK"):
            warnings.simplefilter("ignore")  # what libraries say to programmers
        return _guarded(lambda: app(words, exit_on_error=False, print_error=False))


def _guarded(command: Callable[[], object]) -> int:
    """The command's exit code; whatever it raises becomes a sentence and a code."""
    try:
        code = command()
        return code if isinstance(code, int) else 0
    except FabcraftError as error:
        say(str(error))
        return error.exit_code
    except CycloptsError as error:
        say(f"{error}\n  fabcraft --help, or fabcraft COMMAND --help, tells what can be given.")
        return 2
    except KeyboardInterrupt:
        say("interrupted, nothing written")
        return INTERRUPTED
    except BrokenPipeError:  # the reader of stdout has left, as in `fabcraft --help | head`
        drop_stdout()
        return 0
    except MemoryError:
        say("there was not enough memory\n  Try --preset draft, or simplify the input mesh.")
        return 3
    except ModuleNotFoundError as error:
        if (error.name or "fabcraft").startswith("fabcraft"):
            return _defect(error)
        say(f"the Python package {error.name} is not installed\n  pip install fabcraft brings it.")
        return 3
    except Exception as error:
        return _defect(error)


def _defect(error: Exception) -> int:
    if os.environ.get("FABCRAFT_TRACEBACK"):
        raise error
    message = " ".join(str(error).split())
    say(
        f"this is a defect in fabcraft: {type(error).__name__}: {message}\n"
        "  Run it again with FABCRAFT_TRACEBACK=1 to see where, and report that."
    )
    return DEFECT
