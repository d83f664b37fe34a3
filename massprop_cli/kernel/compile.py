"""Build the kernel's library beside its sources, where there is a C compiler. Needs nothing but Python itself.

python massprop_cli/kernel/compile.py
"""

import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

FLAGS = ("-std=c99", "-O3", "-ffp-contract=off", "-fPIC", "-shared", "-fvisibility=hidden")


def built(folder: Path) -> Path:
    """The library's place."""
    return folder / f"massprop-kernel{'.dll' if sys.platform == 'win32' else '.so'}"


def compile_in(folder: Path) -> str:
    """Build it; the empty string, or why that was not possible."""
    compiler = shlex.split(os.environ.get("CC") or str(sysconfig.get_config_var("CC") or "cc"))
    if shutil.which(compiler[0]) is None:
        compiler = ["cc"]
    target = built(folder)
    made = target.with_name(f"{target.name}.{os.getpid()}")
    command = [*compiler, *FLAGS, *map(str, sorted(folder.glob("*.c"))), "-o", str(made), "-lm"]
    try:
        run = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        return f"{compiler[0]}: {error.strerror}"
    if run.returncode:
        made.unlink(missing_ok=True)
        return run.stderr.strip() or f"{compiler[0]} ended with {run.returncode}"
    made.replace(target)
    return ""


if __name__ == "__main__":
    sys.exit(compile_in(Path(__file__).parent) or 0)
