"""All commands, and the translation of errors into exit codes."""

import inspect
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, get_args

from cyclopts import (
    App,
    CycloptsError,
    Group,
    MissingArgumentError,
    Parameter,
    Token,
    UnknownOptionError,
    UnusedCliTokensError,
)
from cyclopts import convert as convert_tokens

from jotlight._engine import __version__
from jotlight.cli.calibrate import calibrate
from jotlight.cli.compare import compare
from jotlight.cli.convert import convert
from jotlight.cli.demo import demo
from jotlight.cli.evaluate import evaluate
from jotlight.cli.film import film
from jotlight.cli.fine_tune import fine_tune
from jotlight.cli.gather import gather
from jotlight.cli.info import info
from jotlight.cli.options.common_options import convert_file
from jotlight.cli.plan import plan
from jotlight.cli.reconstruct import reconstruct
from jotlight.cli.reproduce import reproduce
from jotlight.cli.simulate import simulate
from jotlight.cli.terminal.console import err, error, out, show_warning
from jotlight.cli.terminal.examples import EXAMPLES, USAGES, help_epilogue, overview_epilogue
from jotlight.cli.terminal.signals import (
    STOPPED_BY_SIGNAL,
    StoppedBySignalError,
    end_at_once,
    exit_on_signals,
    silence_pending_tasks,
)
from jotlight.cli.train import train
from jotlight.cli.view import view
from jotlight.errors import counted, error_message
from jotlight.formats.opening.locations import STANDARD_INPUT

COMMANDS: tuple[Callable[..., None], ...] = (
    demo,
    compare,
    simulate,
    reconstruct,
    film,
    calibrate,
    train,
    fine_tune,
    evaluate,
    reproduce,
    plan,
    info,
    convert,
    gather,
    view,
)
"""All commands, in the order of the help page."""

REFUSED, USAGE, STOPPED = 1, 2, 130
"""Exit codes for refused input, a wrong command line, and Ctrl-C."""


def _shown_default(value: object) -> object:
    """Return the default to show in the help page: on or off for a flag."""
    return {False: "off", True: "on"}[value] if isinstance(value, bool) else value


def _has_fraction(text: str) -> bool:
    """Return whether a text is a number, but no whole one."""
    try:
        return not float(text).is_integer()
    except ValueError:
        return False


def _convert(kind: Any, tokens: Sequence[Token]) -> Any:
    """Return the value of an option or an argument.

    cyclopts would round a number with a fraction where a whole number is expected. Paths are
    completed, but other texts are not. Texts that may name a file have their own converter.
    """
    if kind is int or set(get_args(kind)) == {int, type(None)}:
        for token in tokens:
            if _has_fraction(token.value):
                raise ValueError(f"expected a whole number, got {token.value}.")
    return convert_file(kind, tokens) if _is_path(kind) else convert_tokens(kind, tokens)


def _is_path(kind: Any) -> bool:
    """Return whether a type is that of paths, or contains it, as `Path | None` does."""
    return kind is Path or any(map(_is_path, get_args(kind)))


app = App(
    name="jotlight",
    help="Images from the bits of single-photon cameras.",
    version=f"jotlight {__version__}",
    # An option that occurs twice takes its last value, as in most shells' tools.
    default_parameter=Parameter(
        negative=(), allow_repeating=True, show_default=_shown_default, converter=_convert
    ),
    group_parameters=Group("Options", sort_key=0),
    help_epilogue=overview_epilogue(),
    help_format="markdown",
    console=out,
    error_console=err,
    suppress_keyboard_interrupt=False,
)
for number, command in enumerate(COMMANDS):
    name = command.__name__.replace("_", "-")
    app.command(
        command,
        name=name,
        sort_key=number,
        usage=USAGES.get(name),
        help_epilogue=help_epilogue(name),
    )
app.register_install_completion_command(help="Install completion for the current shell.")


def run(argv: Sequence[str]) -> int:
    """Run one command line and return its exit code.

    Errors that the user can correct print one line, without a traceback.

    Parameters
    ----------
    argv : sequence of str
        The words after ``jotlight``.
    """
    try:
        app(argv, exit_on_error=False, print_error=False, result_action="return_value")
    except KeyboardInterrupt:
        silence_pending_tasks()
        error("stopped")
        return STOPPED
    except CycloptsError as reason:
        name = " ".join(("jotlight", *(reason.command_chain or ())))
        error(f"{_explain(reason)} Try '{name} --help'.")
        return USAGE
    except (
        ValueError,
        TypeError,
        OSError,
        ImportError,
        MemoryError,
        ArithmeticError,
    ) as reason:
        error(error_message(reason))
        return REFUSED
    return 0


def _explain(reason: CycloptsError) -> str:
    """Return what is wrong with the words of a command line."""
    if isinstance(reason, UnknownOptionError) and reason.token.value == str(STANDARD_INPUT):
        return (
            f"{STANDARD_INPUT}: standard input is for `jotlight view {STANDARD_INPUT} --follow`; "
            "elsewhere, write it to a file first."
        )
    command = (reason.command_chain or ("",))[0]
    if isinstance(reason, MissingArgumentError) and reason.keyword is None:  # not only its value
        assert reason.argument is not None, "the missing one"
        return f"{reason.argument.name} is required, as in `{EXAMPLES[command][0]}`."
    if isinstance(reason, UnusedCliTokensError) and reason.target is not None:
        kinds = [each.kind for each in inspect.signature(reason.target).parameters.values()]
        number = sum(kind is not inspect.Parameter.KEYWORD_ONLY for kind in kinds)
        more = " ".join(reason.unused_tokens or ())
        return f"`jotlight {command}` takes {counted(number, 'argument')}; leave out {more}."
    return str(reason)


def main() -> None:
    """Run the command line of this process."""
    warnings.showwarning = show_warning
    exit_on_signals()
    try:
        status = run(sys.argv[1:])
    except StoppedBySignalError as stop:
        status = stop.args[0]
    if status >= STOPPED_BY_SIGNAL:
        end_at_once(status)
    sys.exit(status)
