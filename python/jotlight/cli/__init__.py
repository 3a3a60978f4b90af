"""The command line: one file per command, with the words of the Python interface."""

import functools
import warnings
from collections.abc import Callable
from typing import Annotated

import typer

from jotlight import __version__
from jotlight.cli.calibrate import calibrate
from jotlight.cli.compare import compare
from jotlight.cli.console import error, show_warning
from jotlight.cli.convert import convert
from jotlight.cli.demo import demo
from jotlight.cli.evaluate import evaluate
from jotlight.cli.info import info
from jotlight.cli.plan import plan
from jotlight.cli.reconstruct import reconstruct
from jotlight.cli.reproduce import reproduce
from jotlight.cli.signals import quiet_tasks, stop_by_exceptions
from jotlight.cli.simulate import simulate
from jotlight.cli.train import train

app = typer.Typer(
    help="Pictures from the bits of single-photon cameras.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _plain_errors(command: Callable[..., None]) -> Callable[..., None]:
    """Say in one line, without a traceback, what the user can mend; Ctrl-C too."""

    @functools.wraps(command)
    def run(*arguments: object, **options: object) -> None:
        try:
            command(*arguments, **options)
        except KeyboardInterrupt:
            quiet_tasks()
            error("stopped")
            raise typer.Exit(130) from None
        except (
            ValueError,
            TypeError,
            OSError,
            ImportError,
            MemoryError,
            ArithmeticError,
        ) as reason:
            # Without the number that Python puts before the words of an OSError.
            ours = isinstance(reason, OSError) and reason.filename is None and reason.strerror
            error(ours or str(reason) or type(reason).__name__)
            raise typer.Exit(1) from None

    return run


COMMANDS = (
    demo,
    compare,
    simulate,
    reconstruct,
    calibrate,
    train,
    evaluate,
    reproduce,
    plan,
    info,
    convert,
)

for command in COMMANDS:
    app.command()(_plain_errors(command))


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"jotlight {__version__}")
        raise typer.Exit


@app.callback()
def _global_options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    pass


def main() -> None:
    """Run the command line."""
    warnings.showwarning = show_warning
    stop_by_exceptions()
    app()
