"""The command `flexmbd`; its subcommands stand in flexmbd.command, one a file (docs/command_line.md).

Exit codes: 0 for success, 1 where what was asked for failed (a check, a simulation), 2 for wrong arguments and whatever
else ends in an error of flexmbd, 130 after Ctrl-C. Under `mpirun` every rank runs the same command, and rank 0 speaks;
a subcommand that is not collective runs there alone.

Little loads with this file, so that Ctrl-C finds `main` from the first moments on.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Sequence

from flexmbd.command.interrupts import INTERRUPTED, exits_at_once, ignore_interrupts, say_stopped
from flexmbd.errors import FlexmbdError

_FAULT = 2
_BROKEN_PIPE = 141  # as a shell has it for a program that SIGPIPE ended


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand; collective where the subcommand is.

    Args:
        arguments: the words after `flexmbd`; those of the command line if None.

    Returns:
        The exit code.
    """
    try:
        with exits_at_once():
            from flexmbd.command.subcommands import parsed
            from flexmbd.command.terminal import is_root, print_warning

            if isinstance(sys.stdout, io.TextIOWrapper):  # what the terminal has no letters for, as in names of files
                sys.stdout.reconfigure(errors="backslashreplace")
            chosen = parsed(sys.argv[1:] if arguments is None else list(arguments))
        if not chosen.collective and not is_root():
            return 0
        try:
            code = int(chosen.run(chosen))
            sys.stdout.flush()
        except FlexmbdError as error:
            print_warning(str(error))
            code = _FAULT
    except KeyboardInterrupt:
        say_stopped()
        code = INTERRUPTED
    except BrokenPipeError:
        _forget_stdout()
        code = _BROKEN_PIPE
    if arguments is None:  # the process ends now, and has said all
        ignore_interrupts()
    return code


def _forget_stdout() -> None:
    """Let the interpreter flush what the reader no longer wants into nothing."""
    try:
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, sys.stdout.fileno())
    except (OSError, ValueError):  # no file behind stdout
        return
