"""Common behaviour of all commands: errors in one line, on any terminal."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable

from radron.agent.errors import RadronError
from radron.agent.extras import remedy
from radron.protocol.errors import ProtocolError

USER_ERROR = 2  # exit code of errors that the user can fix
_BROKEN_PIPE = 141  # as the shell has it of a process that SIGPIPE ends


def run_command(name: str, command: Callable[[], object]) -> None:
    """Run a command; an error that the user can fix ends it with one line of text, which begins with ``name``, and exit code 2.

    Characters that the terminal's encoding lacks are written as escapes, instead of a traceback in the middle of a report.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        command()
    except (RadronError, ProtocolError) as error:
        _end(name, str(error))
    except ModuleNotFoundError as error:
        missing = remedy(error.name or "")
        if missing is None:
            raise
        _end(name, missing)
    except BrokenPipeError:  # the reader has gone, such as `head`; nothing more can be written, not even on exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(_BROKEN_PIPE)
    except OSError as error:  # mostly the disk: full, missing or no permission
        _end(name, f"{error.filename or 'input or output'}: {error.strerror or error}")


def _end(name: str, text: str) -> None:
    print(f"{name}: {text}", file=sys.stderr)
    sys.exit(USER_ERROR)
