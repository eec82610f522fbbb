"""The command line: results to standard output, errors in one plain sentence to standard error."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING, Any, NoReturn

from . import process

if TYPE_CHECKING:
    import click

    from .commands import cli


def main(arguments: list[str] | None = None) -> NoReturn:
    """The `pmsm-rs` command.

    Exits with 0 done, 1 internal fault, 2 usage, 3 data refused, 4 not settled, 130 interrupted. Without
    `arguments` it takes those of the process, which then belongs to it: SIGTERM interrupts as Ctrl-C does.
    """
    own = arguments is None
    try:
        process.prepare(own)
        code = _run(arguments)
    except KeyboardInterrupt:
        process.interrupted(own, process.INTERRUPTED_SENTENCE)
    process.end(own, code)


def _run(arguments: list[str] | None) -> int:
    """Runs a command and gives its exit code; what fails is said on standard error."""
    # A command ends soon: until then its allocator, which looks here when the core is loaded, keeps what was
    # freed; else the system would clear the same memory for every fit anew.
    os.environ.setdefault("MIMALLOC_PURGE_DELAY", "-1")
    import click

    from . import terminal
    from .commands import cli

    streams = sys.stdout, sys.stderr
    try:
        given = sys.argv[1:] if arguments is None else arguments
        code = cli.main(arguments, prog_name="pmsm-rs", standalone_mode=False, obj=tuple(given))
        terminal.flush()
    except click.exceptions.Exit as stop:
        return terminal.flushed(stop.exit_code)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        return terminal.USAGE
    except click.ClickException as error:
        terminal.say(_wrong_usage(error))
        return terminal.USAGE
    except click.Abort:
        raise KeyboardInterrupt from None
    except SystemExit:
        # Where the reader of the output has gone, click puts others in the place of the streams and ends.
        if sys.stdout is streams[0]:
            raise
        sys.stdout, sys.stderr = streams
        return terminal.said(BrokenPipeError())
    except BaseException as error:
        from ..errors import is_panic

        if not isinstance(error, Exception) and not is_panic(error):
            raise
        return terminal.said(error)
    return code if isinstance(code, int) else 0


def _wrong_usage(error: click.ClickException) -> str:
    """What a wrong call says, and where its help is."""
    import click

    if isinstance(error, click.MissingParameter) and getattr(error.param, "name", "") == "machine_file":
        return (
            "no machine file was named, a TOML file with what is known of the motor; "
            "pmsm-rs inspect RECORDING --write machine.toml makes one, --machine machine.toml names it "
            "[PR018]"
        )
    context = getattr(error, "ctx", None)
    command = "pmsm-rs" if context is None else context.command_path
    message = error.format_message().rstrip(".")
    return f"{message}{' See' if message.endswith('?') else '; see'} {command} --help [PR001]"


def __getattr__(name: str) -> Any:
    """The group of commands, imported as it is asked for."""
    if name == "cli":
        from .commands import cli

        return cli
    raise AttributeError(name)


__all__ = ["cli", "main"]
