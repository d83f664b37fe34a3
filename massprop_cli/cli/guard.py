"""Exit codes: each error becomes one line on stderr and an exit code of the contract."""

import os
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, NoReturn

import typer

from massprop_cli.base import exits
from massprop_cli.base.errors import InputError, UsageError
from massprop_cli.cli.terminal import say

PACKAGE = Path(__file__).parents[1]
_BEGINS = 1000
"""Number of leading bytes of a JUnit file that contain its first element."""


def guarded(command: Callable[..., None]) -> Callable[..., None]:
    """Decorate a command: each error becomes one line on stderr and an exit code of the contract."""

    @wraps(command)
    def run(*args: Any, **kwargs: Any) -> None:
        try:
            command(*args, **kwargs)
        except InputError as error:
            fail(f"{error} (--{error.option})" if error.option else str(error), exits.INPUT)
        except UsageError as error:
            fail(str(error), exits.USAGE)
        except (typer.Exit, typer.Abort):
            raise
        except KeyboardInterrupt:
            fail("interrupted", exits.INTERRUPTED)
        except MemoryError:
            fail("not enough memory for this input; check the file and its units", exits.INPUT)
        except BrokenPipeError:
            raise typer.Exit(exits.PIPE) from None
        except OSError as error:
            fail(f"the output cannot be written ({error.strerror or error}); is the disk full or the pipe closed?", exits.INPUT)
        except Exception as error:
            if isinstance(error, EOFError) and "marshal" in str(error):  # CPython issue 126606: a full disk may truncate compiled files
                fail(f"Python's compiled files are truncated, as by a full disk; remove __pycache__ below {PACKAGE}", exits.INPUT)
            if os.environ.get("MASSPROP_DEBUG"):
                raise
            fail(f"internal error (a bug in massprop): {type(error).__name__}: {error}. MASSPROP_DEBUG=1 shows where", exits.BUG)

    return run


def fail(message: str, code: int) -> NoReturn:
    """Print ``message`` on stderr and exit with ``code``."""
    say(message)
    raise typer.Exit(code)


def check_junit(file: Path | None) -> None:
    """Raise :class:`UsageError` if a ``--junit`` file cannot be written, or would replace a file that is not JUnit XML."""
    if file is None:
        return
    check_utf8("--junit", file)
    if file.is_dir() or not file.parent.is_dir():
        raise UsageError(f"--junit {file}: name a file in a folder that exists")
    if file.exists() and not (file.is_file() and _is_junit(file)):
        raise UsageError(f"--junit {file}: exists already and is not JUnit XML; name another file")


def put_junit(file: Path, text: str) -> None:
    """Write JUnit XML to a file that :func:`check_junit` accepted."""
    from massprop_cli.base import files

    with files.writing(file, "file", "junit"), files.held(file.parent):
        files.text(file, text)


def _is_junit(file: Path) -> bool:
    with file.open("rb") as opened:
        begins = opened.read(_BEGINS)
    return not begins or b"<testsuite" in begins


def check_utf8(option: str, path: Path | None) -> None:
    """Raise :class:`UsageError` for a path that is not UTF-8, which results and terminals cannot show."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise UsageError(f"{option} {str(path)!r}: is not UTF-8; choose another name") from None


def folder_of_its_own(out: Path | None) -> None:
    """Raise :class:`UsageError` if ``--out`` names no folder, the current folder or one above it."""
    if out is None:
        return
    check_utf8("--out", out)
    here = Path.cwd()
    if not str(out).strip(". ") or Path(os.path.realpath(out)) in (here, *here.parents):
        raise UsageError(f"--out {str(out)!r}: is the current folder, or one above it; name a folder of its own")
