"""The campaign file: the logs and their settings. The models below are the schema (``massprop schema campaign``)."""

from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import Annotated, Any, Literal, Self

from pydantic import Field, StringConstraints, model_validator

from massprop_cli.base import configfile
from massprop_cli.campaign import location
from massprop_cli.campaign.plan import FoundLog, Settings
from massprop_cli.inputs.require import Stated
from massprop_cli.inputs.section import NonNegative, Section

Text = Annotated[str, StringConstraints(min_length=1)]


class LogSettings(Section):
    """Settings of all logs, or of some."""

    vehicle: Text | None = Field(None, description="vehicle file, from this file's folder; absent: each log's own")
    map: Text | None = Field(None, description="map file, from this file's folder; absent: each log's own, if it has one")
    expect: Text | None = Field(None, description="expect file, from this file's folder")
    method: Literal["default", "thesis"] | None = None
    delay: NonNegative | Literal["auto"] | None = Field(None, description="command delay in control cycles")
    require: Stated | None = Field(None, description='quantities that must converge, and how precisely: "mass<2%, ixx", or a list')
    allow_contradicted: bool | None = Field(None, description="whether a log may contradict its vehicle file without exit code 6")
    set: tuple[Text, ...] = Field((), description='overrides of vehicle-file keys, each "KEY=VALUE"')
    tags: tuple[Text, ...] = Field((), description="words of your own, for the tables")


class Match(LogSettings):
    """What is said of the logs that fit; of several that fit, the last that says a thing counts, tags and overrides add up."""

    logs: tuple[Text, ...] = Field(min_length=1, description="patterns of paths from this file's folder; * fits / too")


class Combine(Section):
    """Logs whose results become one, as `massprop combine` makes it."""

    name: Text = Field(description="of its result folder")
    logs: tuple[Text, ...] = Field((), description="patterns of paths from this file's folder: two logs or more of one vehicle")
    before: tuple[Text, ...] = Field((), description="the same of the vehicle alone; with after, instead of logs")
    after: tuple[Text, ...] = Field((), description="the same of the vehicle with the docked object")
    added: Text | None = Field(None, description="mass and place of that object, as `massprop combine --added` takes it: the scale of all")
    require: Stated | None = Field(None, description="what must converge in every phase of it, and how precisely")

    @model_validator(mode="after")
    def _has_one_of_both(self) -> Self:
        if bool(self.logs) == bool(self.before or self.after) or bool(self.before) != bool(self.after):
            raise ValueError("name logs alone, or before and after")
        if self.added is not None and self.logs:
            raise ValueError("added is an object between two logs; name before and after")
        return self


class CampaignFile(LogSettings):
    """A whole campaign file."""

    schema_: Literal[1] = Field(1, alias="schema")
    name: Text | None = Field(None, description="absent: the file's name")
    logs: tuple[Text, ...] = Field(min_length=1, description="files, folders (with all below) and globs, from this file's folder")
    report: bool = Field(False, description="render report.html of each log")
    match: tuple[Match, ...] = ()
    combine: tuple[Combine, ...] = ()


def load(place: str) -> CampaignFile:
    """Read a campaign file; raise :class:`massprop_cli.base.errors.InputError` with file, line and key if it is not valid."""
    text = location.read_text(place, "campaign file")
    return configfile.validate(CampaignFile, configfile.parse_toml(text, place), place, text)


def matches(patterns: Sequence[str], below: str) -> bool:
    """Whether a pattern matches a log's path from the campaign file's folder."""
    return any(fnmatchcase(below, pattern.removeprefix("./")) for pattern in patterns)


def applied(file: CampaignFile, base: str, log: FoundLog, below: str) -> FoundLog:
    """The log with its settings from the file; ``below`` is its path from the file's folder ``base``."""
    sections: Sequence[LogSettings] = [file, *(rule for rule in file.match if matches(rule.logs, below))]

    def last(key: str) -> Any:
        return next((value for section in reversed(sections) if (value := getattr(section, key)) is not None), None)

    files: dict[str, Any] = {
        key: None if (named := last(key)) is None else location.join(base, named) for key in ("vehicle", "map", "expect")
    }
    settings = Settings(
        **files,
        assignments=tuple(assignment for section in sections for assignment in _assignments(section)),
        require=last("require") or (),
        report=file.report,
        allow_contradicted=bool(last("allow_contradicted")),
    )
    return replace(log, settings=settings, tags=tuple(dict.fromkeys(tag for section in sections for tag in section.tags)))


def _assignments(section: LogSettings) -> list[str]:
    """Overrides of vehicle-file keys, ``KEY=VALUE``."""
    assignments = [*section.set]
    assignments += [f'estimator.method="{section.method}"'] if section.method else []
    if section.delay is not None:
        delay = '"auto"' if section.delay == "auto" else repr(float(section.delay))
        assignments.append(f"cycle.command_delay_cycles={delay}")
    return assignments
