"""Where there is a C compiler the wheel holds the compiled kernel; elsewhere it holds its sources alone, and NumPy does its work."""

from __future__ import annotations

import importlib.util
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CustomBuildHook(BuildHookInterface[Any]):
    """Compiles the kernel beside its sources, for a wheel and for an editable install."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:  # noqa: ARG002  hatchling's own signature
        """The library is loaded by ctypes, so that one wheel serves every Python of a platform."""
        folder = Path(self.root) / "massprop_cli" / "kernel"
        spec = importlib.util.spec_from_file_location("compile", folder / "compile.py")
        if spec is None or spec.loader is None:
            raise FileNotFoundError(folder / "compile.py")
        kernel = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(kernel)
        problem = kernel.compile_in(folder)
        if problem:
            self.app.display_warning(f"the kernel was not compiled, so NumPy will do its work: {problem}")
            return
        build_data["artifacts"].append(kernel.built(folder).relative_to(self.root).as_posix())
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{sysconfig.get_platform().replace('-', '_').replace('.', '_')}"
