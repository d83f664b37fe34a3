"""Complete result of one run: inputs as used, fits, tests and conclusions."""

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.conclude.assumptions import AssumptionEffects, SensitivityAnalysis
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
class CorrectedEstimate:
    """Estimates with a named fault corrected."""

    fault: Fault
    settings: tuple[str, ...]
    """KEY=VALUE settings of the vehicle file that correct the fault, with their uncertainty."""
    conclusions: tuple[Conclusion, ...]
    vehicle: Vehicle
    """Vehicle as used with the correction."""
    rivals: tuple[list[Array], ...] = ()
    """(10,) values by phase, for each other cause that the log cannot exclude."""
    complete: bool = True
    """Whether the settings are the whole correction, so that they reproduce the estimates."""


@dataclass(frozen=True)
class Analysis:
    """Complete result of one run. Tuples of results by phase have one element per phase."""

    log: Log
    source: VehicleSource
    vehicle: Vehicle
    """Vehicle as used, with estimated noise levels and disturbances."""
    stated: Vehicle
    """Vehicle with its timing resolved, without estimated noise levels and disturbances."""
    samples: Stream
    timing: Timing
    """Delay and lag as used, cycles."""
    detected: FoundTiming | None
    """Delay and lag as estimated from the log."""
    histories: tuple[History, ...]
    settled: tuple[History, ...]
    """Off-line fits linearised about the final estimates; their innovations test the model."""
    conclusions: tuple[Conclusion, ...]
    docked: Docked | None
    notices: tuple[Notice, ...]
    assignments: tuple[str, ...]
    lack_of_fit: tuple[Array, ...] = ()
    """(6,) by phase: factor by which the sigmas from each channel are too small."""
    mended: tuple[CorrectedEstimate, ...] = ()
    assumptions: tuple[AssumptionEffects, ...] = ()
    examination: SensitivityAnalysis | None = None
    """Sensitivity of the off-line fits to the assumptions; None by the thesis's method."""
    faults: tuple[Fault, ...] = ()
    """Named causes of a misfit."""
    unknown: str = ""
    """Message of a misfit without a named cause; empty if there is none."""
    plain: PlainFits | None = None
    """Off-line fits with the stated noise; None by the thesis's method."""
    discrepancies: tuple[Discrepancy | None, ...] = ()
    """By phase: model discrepancy that the sigmas include; None without one."""
    cross_validations: tuple[CrossValidation | None, ...] = ()
    """By phase, if ``estimator.cross_validate`` is stated; None where a phase has no estimate."""
    doubts: tuple[Doubt, ...] = ()
    """Assumptions and channels with a significant score test."""
