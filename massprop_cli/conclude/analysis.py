"""All that one run found, with what it was found from."""

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.conclude.assumptions import AssumptionEffects, Examined
from massprop_cli.conclude.discrepancy import Discrepancy, PlainFits
from massprop_cli.conclude.docking import Docked
from massprop_cli.conclude.score import Doubt
from massprop_cli.conclude.verdict import Conclusion
from massprop_cli.diagnosis.delay import FoundTiming
from massprop_cli.diagnosis.fault import Fault
from massprop_cli.estimate.crossvalidation import CrossValidation
from massprop_cli.estimate.history import History
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing


@dataclass(frozen=True)
class MendedAnswer:
    """What the log gives if a named fault is corrected."""

    fault: Fault
    settings: tuple[str, ...]
    """KEY=VALUE of the vehicle file that correct it, with how uncertain they are."""
    conclusions: tuple[Conclusion, ...]
    vehicle: Vehicle
    """As used then."""
    rivals: tuple[list[Array], ...] = ()
    """(10,) values of each phase, for each cause that can't be ruled out beside it."""
    whole: bool = True
    """Whether the settings are all that was changed, so that they give the very same."""


@dataclass(frozen=True)
class Analysis:
    """Everything that one run found, with what it was found from."""

    log: Log
    source: VehicleSource
    vehicle: Vehicle
    """As used: with the noise levels and disturbances that a first pass set."""
    stated: Vehicle
    """With its timing resolved, but without what a first pass sized."""
    samples: Stream
    timing: Timing
    """Delay and lag as used, cycles."""
    detected: FoundTiming | None
    """What the log says of them."""
    histories: tuple[History, ...]
    settled: tuple[History, ...]
    """The same about their final estimates: their innovations say whether the model holds."""
    conclusions: tuple[Conclusion, ...]
    docked: Docked | None
    notices: tuple[Notice, ...]
    assignments: tuple[str, ...]
    lack_of_fit: tuple[Array, ...] = ()
    """(6,) of each phase: by how much too small the sigmas of each channel are."""
    mended: tuple[MendedAnswer, ...] = ()
    assumptions: tuple[AssumptionEffects, ...] = ()
    examination: Examined | None = None
    """What each assumption does to the off-line fits; None by another method, and where there is none."""
    faults: tuple[Fault, ...] = ()
    """What has a name."""
    unknown: str = ""
    """Why nothing has, where something should."""
    plain: PlainFits | None = None
    """As stated; None by another method."""
    discrepancies: tuple[Discrepancy | None, ...] = ()
    """Of each phase whose sigmas include what log and vehicle file don't explain of one another."""
    cross_validations: tuple[CrossValidation | None, ...] = ()
    """Of each phase, where ``estimator.cross_validate`` asks for them; None where a phase has no estimate."""
    doubts: tuple[Doubt, ...] = ()
    """Assumptions that the log contradicts, or all but does."""
