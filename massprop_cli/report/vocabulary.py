"""Texts of all reports: names, units, conventions, verdicts, and reasons and remedies for values that are not converged."""

from massprop_cli import ABOUT_PIVOT as NINE
from massprop_cli import CG, PIVOT
from massprop_cli.conclude.reason import HARDLY_INFORMED, NOT_WHITE
from massprop_cli.conclude.verdict import WANTED, Verdict
from massprop_cli.inputs.equipment import EnvironmentKind
from massprop_cli.result.judge import contradiction, parts
from massprop_cli.result.schema import EstimateItem, PhaseItem, Result, VehicleInfo

SYMBOLS = {
    "ixx": "Ixx", "ixy": "Ixy", "ixz": "Ixz", "iyy": "Iyy", "iyz": "Iyz", "izz": "Izz",
    "cg_x": "CG x", "cg_y": "CG y", "cg_z": "CG z", "mass": "Mass",
    "moment_x": "Moment x", "moment_y": "Moment y", "moment_z": "Moment z",
}  # fmt: skip
SYMBOLS |= {f"{PIVOT}{name}": f"{SYMBOLS[name]} about pivot" for name in NINE}
"""Symbol of each quantity by its name; quantities about the pivot also with the prefix."""
VERDICTS: dict[Verdict, str] = {
    "converged": "informed by the motion, and steady within tolerance to the end",
    "not_converged": "informed, but not steady within tolerance long enough; record a longer log",
    "not_excited": "another motion of this vehicle makes it observable; the commands of this log did not, or disturbances exceeded them",
    "contradicted": "the log contradicts the vehicle file: the sigma is not valid; do not use the value",
    "unobservable": "no motion of this vehicle makes it observable by this method",
}
SIGNS: dict[str, str] = {"converged": "✓", "not_converged": "~", "not_excited": "○", "contradicted": "‼", "unobservable": "✕"}
"""Sign for each verdict, so that colour is not the only distinction."""


ENVIRONMENTS: dict[EnvironmentKind, str] = {
    "free": "free flight",
    "air_bearing": "air bearing",
    "pedestal": "on a pedestal",
    "planar": "on a table",
}
ABOUT_PIVOT = "about the pivot"
ON_PEDESTAL = (
    "On a fixed pedestal the motion gives inertia and first moment about the pivot, moment = mass × (CG − pivot). CG and inertia about it "
    "need a weighed mass (known.mass)."
)
ON_TABLE = "On a table the vehicle slides and yaws: Izz, CG x, CG y and mass are estimated; nothing else affects that motion."


def unit(text: str) -> str:
    """A unit with typographic exponents."""
    return text.replace("^2", "²")


def motion_for(quantity: str) -> str:
    """The motion that would inform a quantity."""
    return WANTED[quantity.removeprefix(PIVOT)]


def conventions(result: Result) -> list[str]:
    """Sentences on frame, reference point, sign of products, mass, sigmas and thrust scale."""
    bearing = result.vehicle.environment == "air_bearing"
    lines = [
        f"Inertia is that of the {'rotating body' if bearing else 'body'} about its CG, in body axes.",
        "Products are the tensor's own elements, ixy = −Σ m x y; in the positive-integral convention they have the opposite sign.",
        "CG is the position from O, the vehicle's declared reference point, in body axes.",
    ]
    if result.provenance.method != "thesis":
        contradicted = any(contradiction(body) for _, body in parts(result))
        lines.append(f"± is one standard deviation{'; that of a contradicted quantity is not valid' if contradicted else ''}.")
    if bearing:
        lines.append(f"Mass includes the bearing's {result.vehicle.bearing_mass_kg:g} kg, which does not rotate.")
    if result.vehicle.environment == "planar":
        lines.append(ON_TABLE)
    if result.vehicle.environment == "pedestal":
        lines.append(ON_PEDESTAL)
    return [*lines, thrust_scale(result)]


def pushed_by(vehicle: VehicleInfo) -> str:
    """Actuators that exert external forces, in words; empty without any."""
    jets, rotors = len(vehicle.jets), len(vehicle.rotors)
    if vehicle.commands == "jets":
        return f"{jets} jet{'s' * (jets > 1)}" if jets else ""
    return f"{rotors} rotor{'s' * (rotors > 1)}" if rotors else "torque and force"


def commands(vehicle: VehicleInfo) -> str:
    """The kind of commands, in words."""
    stored = f"the momentum stored in {', '.join(vehicle.wheels)}" if vehicle.wheels else ""
    by = [each for each in (pushed_by(vehicle), stored) if each]
    return f"commands by {' and by '.join(by)}" if by else "no commands"


SAME_THRUST = (
    "The docked object's values are differences and assume the same thrust before and after docking: 1 % less thrust after docking makes "
    "them larger by 1 % of the combined body's values."
)


def thrust_scale(result: Result) -> str:
    """Sentences on the thrust scale, which the log cannot show, and on its part of the sigmas."""
    return _thrust_scale(result) + ("" if result.docked_object is None else f" {SAME_THRUST}")


def _thrust_scale(result: Result) -> str:
    vehicle = result.vehicle
    if result.provenance.method == "thesis":
        return "Sigmas of the thesis's filters are its “precision”: they depend on noise only and are not errors."
    if vehicle.wheels and (not pushed_by(vehicle) or all(phase.estimates["mass"].verdict == "unobservable" for phase in result.phases)):
        return "Inertia is proportional to the stored momentum that the vehicle file states."
    if vehicle.wheels:
        scaled = "Inertia scales" if vehicle.environment == "pedestal" else "Inertia and mass scale"
        return f"{scaled} with stored momentum and thrust; sigmas include the uncertainty of both that the log leaves."
    if vehicle.commands == "jets" and not vehicle.jets:
        return "Only gravity turns this body: a swing gives ratios, and [known] values give their scale."
    scale = "Mass and inertia are proportional to the thrust that the vehicle file states; the log cannot show a scale common to all thrust"
    if not vehicle.thrust_scale_sigma > 0:
        return f"{scale}, and no thrust.scale_sigma is stated (with it a weighed mass under [known] calibrates the scale)."
    known_by_phase = {phase.name: [name for name in phase.known if name not in CG] for phase in result.phases}
    names = ", ".join(sorted({name for known in known_by_phase.values() for name in known}))
    if names and all(known_by_phase.values()):
        return f"{scale}. Here these known values calibrate it: {names}."
    stated = f"{scale}. Every sigma of mass and inertia includes its stated uncertainty, {100 * vehicle.thrust_scale_sigma:g} %"
    where = " and ".join(phase for phase, known in known_by_phase.items() if known)
    return f"{stated}; in phase {where} these known values calibrate it: {names}." if where else f"{stated}."


_UNOBSERVABLE = {
    "no-part": "another test: in free flight, or on an air bearing",
    "unweighed": "weigh the vehicle and state known.mass, or push it along the table",
    "unweighed-pedestal": "weigh the vehicle and state known.mass",
    "ratios-only": "state known.ixx, known.iyy and known.izz, or command torques",
}
"""Remedies by the reason why a quantity is unobservable."""


def remedy(quantity: str, verdict: str, contradiction: str = "", reason_code: str = "") -> str:
    """Remedy for a quantity that is not converged; in a contradicted phase, no motion is a remedy."""
    if verdict == "contradicted":
        return "correct the cause; no motion helps"
    if contradiction and verdict != "unobservable":
        return "correct the contradiction of this phase first"
    if verdict == "not_converged" and reason_code in NOT_WHITE:
        return "find and remove the disturbance, or cut the log there"
    if verdict == "not_converged" and reason_code == "oscillation":
        return "fix or drain the part that oscillates, or push so rarely that it comes to rest"
    if verdict == "not_converged":
        return f"a longer log, with more {motion_for(quantity)}"
    if verdict == "unobservable":
        other = f"{motion_for(quantity)}: the commands of this vehicle cannot give it; add thrusters, or state a measured value ([known])"
        return _UNOBSERVABLE.get(reason_code, other)
    return motion_for(quantity)


NAMES_MOTION = (
    *("no-motion-informs", "sensor-absent", "sensor-absent-mass", "hardly-informed", "no-part"),
    *("unweighed", "unweighed-pedestal", "ratios-only"),
)
"""Codes of reasons whose text already names the informing motion, or that there is none."""


def gaps(found: Result) -> list[str]:
    """A sentence for each quantity of each phase that is not converged, with verdict, reason and remedy."""
    return [
        f"{name} in {part}: {gap(name, item, contradiction(body))}"
        for part, body in parts(found)
        if isinstance(body, PhaseItem)
        # quantities about the pivot have a sentence only if the ten are unobservable
        for name, item in {**body.estimates, **(body.about_pivot if body.estimates["izz"].verdict == "unobservable" else {})}.items()
        if item.verdict != "converged"
    ]


def gap(quantity: str, item: EstimateItem, contradicted: str = "") -> str:
    """Verdict, reason and remedy of a quantity that is not converged; ``contradicted`` is the contradiction of its phase."""
    text = f"{item.verdict}: {reason(item, contradicted)}"
    if contradicted and item.verdict != "unobservable":
        return f"{text}; {remedy(quantity, item.verdict, contradicted)}"
    return text if item.reason_code in NAMES_MOTION else f"{text}; it needs {motion_for(quantity)}"


def reason(item: EstimateItem, contradicted: str = "") -> str:
    """Reason of a verdict; in a contradicted phase without a motion that would inform the quantity."""
    if item.verdict == "contradicted":
        return contradicted or item.reason
    return HARDLY_INFORMED if contradicted and item.reason_code == "hardly-informed" else item.reason
