"""One folder with all pages, written and made, and Zensical's configuration with their order."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import tomli_w

from massprop_cli import schemas
from website import commands, files, python

ROOT = Path(__file__).parents[1]
GOOD = [
    "methods.md",
    "accuracy.md",
    "any-vehicle.md",
    "planar-accuracy.md",
    "geometry.md",
    "faults.md",
    "unforeseen.md",
    "cases.md",
    "check.md",
    "causal.md",
    "aboard.md",
    "thesis-tables.md",
    "thesis-tuning.md",
]
FAST = ["engine.md", "campaign.md", "simulate-speed.md"]
Nav = list[dict[str, Any] | str]


def stage(folder: Path) -> Path:
    """Write the pages under ``folder``; the path of the configuration by which Zensical builds them into ``folder``/site."""
    pages = folder / "docs"
    shutil.copytree(ROOT / "docs", pages)
    for name, here in (("README", "index"), ("CHANGELOG", "changelog"), ("SECURITY", "security")):
        (pages / f"{here}.md").write_text(_from_root((ROOT / f"{name}.md").read_text(encoding="utf-8")), encoding="utf-8")
    made = pages / "reference"
    made.mkdir()
    (made / "commands.md").write_text(commands.page(), encoding="utf-8")
    (made / "python.md").write_text(python.page(), encoding="utf-8")
    for name in schemas.NAMES:
        (made / f"{name}.md").write_text(files.page(name), encoding="utf-8")
    configuration = folder / "zensical.toml"
    configuration.write_bytes(tomli_w.dumps({"project": _project(pages)}).encode())
    return configuration


def _from_root(text: str) -> str:
    """Links of a page at the top of the repository, as they are within docs/."""
    for there, here in (("](docs/", "]("), ("](CHANGELOG.md", "](changelog.md"), ("](SECURITY.md", "](security.md")):
        text = text.replace(there, here)
    return text


def _project(pages: Path) -> dict[str, Any]:
    return {
        "site_name": "massprop",
        "site_description": "Mass properties of a vehicle, with honest sigmas, from recorded commands and IMU data",
        "docs_dir": "docs",
        "site_dir": "site",
        "use_directory_urls": False,  # pages open from a folder, without a server
        "nav": navigation(pages),
        "extra": {"generator": False},
        # fonts of the reader's own machine: nothing is loaded from elsewhere
        "theme": {"font": False, "features": ["navigation.sections", "navigation.top", "content.code.copy"], "palette": _PALETTE},
        "markdown_extensions": {
            "admonition": {},
            "attr_list": {},
            "tables": {},
            "toc": {"permalink": True},
            "pymdownx.highlight": {},
            "pymdownx.superfences": {"custom_fences": [{"name": "math", "class": "math", "format": "website.mathml.block"}]},
            "website.mathml": {},
        },
    }


_PALETTE = [
    {"media": "(prefers-color-scheme: light)", "scheme": "default", "toggle": {"icon": "lucide/sun", "name": "Dark"}},
    {"media": "(prefers-color-scheme: dark)", "scheme": "slate", "toggle": {"icon": "lucide/moon", "name": "Light"}},
]


def navigation(pages: Path) -> Nav:
    """The order in which a newcomer reads; what is made from the code comes as it is there."""
    verdicts = [f"verdicts/{name}.md" for name in ("converged", "not_converged", "not_excited", "contradicted", "unobservable")]
    warnings = sorted(f"warnings/{path.name}" for path in (pages / "warnings").glob("*.md") if path.name != "index.md")
    return [
        {"massprop": "index.md"},
        {"Your own log in 15 minutes": "tutorial.md"},
        {"Inputs and outputs": ["log.md", "vehicle.md", "formats.md", "result.md", "reports.md", "pages.md", "exit-codes.md"]},
        {"Tests and campaigns": ["plan.md", "simulate.md", "campaigns.md", "predict.md"]},
        {
            "Tables, wheels, on board": [
                *("planar.md", "pedestal.md", "balance.md", "actuators.md", "wheels.md"),
                *("uncertain-geometry.md", "imu-filters.md", "kernel.md", "control.md"),
            ]
        },
        {
            "Verdicts and warnings": [
                "verdicts/index.md",
                *verdicts,
                {"Warnings": ["warnings/index.md", *warnings]},
                "assumptions.md",
                "discrepancy.md",
                "error-parameters.md",
            ]
        },
        {"How it works": ["theory.md", "where.md"]},
        {"How good": ["how-good.md", *GOOD]},
        {"How fast": FAST},
        {"Limits and licences": ["limits.md", "licences.md", {"Security": "security.md"}]},
        {"Reference": ["reference/commands.md", *(f"reference/{name}.md" for name in schemas.NAMES), "reference/python.md"]},
        {"Contributing": ["contributing.md", "checks.md"]},
        {"Changes": "changelog.md"},
    ]
